// Zarr arrays of version 2 and 3, with shards, and OME-Zarr images.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// A folder with an array or a group. Chunks are decoded by many threads.
VolumeFormat zarr_format();

}  // namespace isonest::detail
