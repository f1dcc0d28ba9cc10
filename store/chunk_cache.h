// Decoded chunks within a byte budget.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>

#include "store/chunk_source.h"

namespace isonest {

/// The decoded bytes of one chunk; stays valid while held, also after its eviction.
using DecodedChunk = std::shared_ptr<const std::byte[]>;

/// Some nodes of a decoded chunk: the one at p, counted from the chunk's first, is element p .
/// stride.
struct ChunkNodes {
    DecodedChunk data;
    Int3 stride;
};

/// Least-recently-used cache over a ChunkSource. A chunk is decoded outside the lock, by the first
/// thread that asks; others wait for it. Chunks that are held count against the budget until they
/// are released, and may exceed it: whoever holds chunks bounds how many.
/// Thread-safety: get() from any thread.
class ChunkCache {
  public:
    ChunkCache(const ChunkSource& source, std::uint64_t budget_bytes)
        : source_(source), budget_(budget_bytes) {}
    ChunkCache(const ChunkCache&) = delete;
    ChunkCache& operator=(const ChunkCache&) = delete;

    [[nodiscard]] const ChunkSource& source() const { return source_; }
    /// Throws what ChunkSource::decode throws.
    DecodedChunk get(const ArrayInfo& array, const Int3& chunk);
    /// The nodes whose coordinates along the axes in `low` (bits x, y, z) are the chunk's first,
    /// all if there are none; more may be there. Throws what ChunkSource::decode throws.
    ChunkNodes nodes(const ArrayInfo& array, const Int3& chunk, unsigned low);
    /// Of this chunk only its three low sides are needed from now on: the others are dropped,
    /// unless somebody holds them. get() decodes it again.
    void keep_low_sides(const ArrayInfo& array, const Int3& chunk);
    /// Largest number of bytes that were alive at any time.
    [[nodiscard]] std::uint64_t peak_bytes() const;

  private:
    struct Entry {
        DecodedChunk chunk;  ///< null while it is being decoded
        std::list<std::uint64_t>::iterator use;
        std::uint64_t bytes = 0;
    };
    using Entries = std::unordered_map<std::uint64_t, Entry>;
    void evict(std::uint64_t incoming);
    Entry& insert(std::uint64_t key, std::uint64_t bytes);
    void erase(Entries::iterator entry);

    const ChunkSource& source_;
    std::uint64_t budget_;
    mutable std::mutex mutex_;
    std::condition_variable decoded_;
    Entries entries_;  ///< by row of the chunk table, twice; plus 1 for the low sides alone
    std::list<std::uint64_t> order_;  ///< least recently used first
    std::uint64_t bytes_ = 0;
    std::uint64_t peak_ = 0;
};

}  // namespace isonest
