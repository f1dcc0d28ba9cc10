// NetCDF's classic files; those of NetCDF-4 are HDF5.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

VolumeFormat netcdf3_format();

}  // namespace isonest::detail
