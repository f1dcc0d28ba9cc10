// A source of decoded chunks: a finished store, or one that is being written.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "store/container/format.h"

namespace isonest::detail {

/// A chunk of an array in the layout of the source.
struct WantedChunk {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
};

/// Thread-safety: all methods from any thread.
class ChunkSource {
  public:
    ChunkSource() = default;
    ChunkSource(const ChunkSource&) = delete;
    ChunkSource& operator=(const ChunkSource&) = delete;
    virtual ~ChunkSource() = default;
    [[nodiscard]] virtual const StoreLayout& layout() const = 0;
    /// Row of the chunk table. REQUIRES: the chunk exists (and, during writing, has been written).
    [[nodiscard]] virtual ChunkRow row(const ArrayInfo& array, const Int3& chunk) const = 0;
    /// Decodes into `raw` (array.chunk_bytes() bytes, [z][y][x][component], x fastest).
    /// Throws Error{corrupt, io}.
    virtual void decode(const ArrayInfo& array, const Int3& chunk,
                        std::span<std::byte> raw) const = 0;
    /// The range of values within a cube of a level; nullopt if it is not stored. Throws
    /// Error{corrupt}.
    [[nodiscard]] virtual std::optional<CubeRange> cube_range(int /*level*/,
                                                              const Int3& /*cube*/) const {
        return std::nullopt;
    }
    /// A hint that the chunk is needed soon. Throws what decode() throws for a bad table.
    virtual void prefetch(const ArrayInfo& /*array*/, const Int3& /*chunk*/) const {}
    /// Whether a chunk that was not prefetched costs a network round trip. It then pays to
    /// determine all chunks that are needed next before decoding any, and to prefetch them
    /// together.
    [[nodiscard]] virtual bool is_remote() const { return false; }
    /// The same hint as prefetch() for chunks that are needed together; returns at once. Chunks
    /// outside the array's grid are ignored. Throws what prefetch() throws.
    virtual void prefetch_all(std::span<const WantedChunk> chunks) const {
        for (const WantedChunk& wanted : chunks) {
            if (wanted.array->has_chunk(wanted.chunk)) {
                prefetch(*wanted.array, wanted.chunk);
            }
        }
    }
    /// A hint that the rows of the chunks in [begin, end) are needed soon, and together; returns at
    /// once. REQUIRES: the chunks are in the array's grid.
    virtual void prefetch_rows(const ArrayInfo& /*array*/, const Int3& /*begin*/,
                               const Int3& /*end*/) const {}
};

}  // namespace isonest::detail
