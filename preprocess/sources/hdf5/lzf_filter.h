// HDF5 filter 32000: LZF, as h5py writes it. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <span>

namespace isonest::detail {

inline constexpr H5Z_filter_t kLzfFilter = 32000;

/// Registers the filter with the HDF5 library in this process, for reading. Idempotent,
/// thread-safe. Does nothing in a build without liblzf, or if a plugin has registered it.
void register_lzf_filter();

/// Whether this build can decompress LZF.
bool has_lzf();

/// Decompresses an LZF chunk into `out`. False if it is not a chunk of that size. REQUIRES:
/// has_lzf().
bool undo_lzf(std::span<const std::byte> in, std::span<std::byte> out);

}  // namespace isonest::detail
