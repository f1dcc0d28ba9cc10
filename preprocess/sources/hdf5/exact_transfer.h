// Reads of HDF5 that stop where a number would be rounded. Private to preprocess.
#pragma once

#include "store/hdf5/handles.h"

namespace isonest::detail {

/// For H5Dread(), which fails where a number cannot be held exactly by the type that is asked for,
/// and sets `lossy` then. REQUIRES: `lossy` outlives the handle.
PropertyHandle exact_transfer(bool& lossy);

}  // namespace isonest::detail
