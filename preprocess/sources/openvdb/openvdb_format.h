// OpenVDB: sparse grids of float32 or float64.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

VolumeFormat vdb_format();

}  // namespace isonest::detail
