// HDF5 filter 32015: one zstd frame per chunk. Registered in-process, and shipped as a plugin.
#pragma once

#include <hdf5.h>

namespace isonest::detail {

/// The filter's description for HDF5.
const H5Z_class2_t& zstd_filter_class();

/// Makes the filter known to the HDF5 library in this process. Idempotent, thread-safe.
void register_zstd_filter();

}  // namespace isonest::detail
