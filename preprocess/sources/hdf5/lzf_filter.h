// HDF5 filter 32000: LZF, as h5py writes it. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <span>

namespace isonest::detail {

inline constexpr H5Z_filter_t kLzfFilter = 32000;

/// Makes the filter known to the HDF5 library in this process, for reading. Idempotent,
/// thread-safe. Does nothing in a build without liblzf, and where a plugin has registered it.
void register_lzf_filter();

/// Whether this build reads it.
bool has_lzf();

/// Fills `out` from a chunk in LZF. False if that is not what it holds. REQUIRES: has_lzf().
bool undo_lzf(std::span<const std::byte> in, std::span<std::byte> out);

}  // namespace isonest::detail
