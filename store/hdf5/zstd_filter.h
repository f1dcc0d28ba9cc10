// HDF5 filter 32015: one zstd frame per chunk. Registered in this process, and also shipped as a
// plugin.
#pragma once

#include <hdf5.h>

namespace isonest::detail {

/// The description of the filter for HDF5.
const H5Z_class2_t& zstd_filter_class();

/// Registers the filter with the HDF5 library in this process. Idempotent, thread-safe.
void register_zstd_filter();

}  // namespace isonest::detail
