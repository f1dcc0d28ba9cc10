// The stored form of a chunk: HDF5's byte shuffle, then one zstd frame with content size and
// checksum.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <isonest/error.h>

#include "store/base/checksum.h"

namespace isonest::detail {

/// How the chunks of an array are stored.
struct CodecSpec {
    std::size_t element_size = 1;  ///< bytes of one element, the unit of the shuffle
    bool shuffle = false;          ///< HDF5 filter 2 before the compression
    int level = 1;                 ///< zstd level
};

/// Compresses `raw` into `out` (replaced). Thread-safe: the contexts are per thread.
void encode_chunk(std::span<const std::byte> raw, const CodecSpec& spec,
                  std::vector<std::byte>& out);

/// Decompresses one stored chunk into `raw`, which has exactly the chunk's size.
/// `place`: of the chunk, for the error. Throws Error{corrupt}. Thread-safe.
void decode_chunk(std::span<const std::byte> stored, const CodecSpec& spec,
                  std::span<std::byte> raw, const ErrorPlace& place);

/// Whether the zstd frames of `packed` fill `raw`; then that is done. Thread-safe.
[[nodiscard]] bool decompress(std::span<const std::byte> packed, std::span<std::byte> raw);
/// Undoes HDF5's shuffle of elements of `size` bytes (2, 4 or 8). REQUIRES: from.size() is a
/// multiple of it, and `to` has as many bytes.
void unshuffle(std::span<const std::byte> from, std::byte* to, std::size_t size);

/// Heap that one thread's contexts and buffers may take for chunks of `chunk_bytes`.
std::size_t codec_heap(std::size_t chunk_bytes, int level);
/// The same of a thread that only decodes.
std::size_t decode_heap(std::size_t chunk_bytes);

}  // namespace isonest::detail
