// Decoded chunks within a byte budget.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// The decoded bytes of one chunk; stays valid while held, also after its eviction.
using DecodedChunk = std::shared_ptr<const std::byte[]>;

/// Some nodes of a decoded chunk: the one at p, counted from the chunk's first, is element p .
/// stride.
struct ChunkNodes {
    DecodedChunk data;
    Int3 stride;
};

/// Which nodes of a chunk its neighbours need: the first `low` and the last `high` ones along each
/// axis.
struct ChunkSides {
    std::int64_t low = 1;
    std::int64_t high = 0;
};

/// A decoded chunk, or its sides alone.
struct ChunkPart {
    DecodedChunk data;
    bool is_whole = false;
};

/// A chunk that is needed soon: all of it, or nodes in its sides alone.
struct NeededChunk {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
    bool whole = true;
};

/// Least-recently-used cache over a ChunkSource. A chunk is decoded outside the lock, by the first
/// thread that asks; others wait for it. Chunks that are held count against the budget until they
/// are released, and may exceed it: whoever holds chunks bounds how many. So may one chunk per
/// thread that is decoded for its sides.
/// Thread-safety: all methods from any thread.
class ChunkCache {
  public:
    /// What an entry takes beside its nodes.
    static constexpr std::uint64_t kEntryOverhead = 192;

    ChunkCache(const ChunkSource& source, std::uint64_t budget_bytes, const ChunkSides& sides = {})
        : source_(source), budget_(budget_bytes), sides_(sides) {}
    ChunkCache(const ChunkCache&) = delete;
    ChunkCache& operator=(const ChunkCache&) = delete;

    [[nodiscard]] const ChunkSource& source() const { return source_; }
    [[nodiscard]] std::uint64_t budget() const { return budget_; }
    /// Tells the source, together, of those that are not here. Those that are here count as just
    /// used. Throws what ChunkSource::prefetch_all throws.
    void announce(std::span<const NeededChunk> needed);
    /// The chunk if it is here, decoded; else null.
    [[nodiscard]] DecodedChunk peek(const ArrayInfo& array, const Int3& chunk) const;
    /// Throws what ChunkSource::decode throws.
    DecodedChunk get(const ArrayInfo& array, const Int3& chunk);
    /// The nodes whose coordinates along the axes in `low` (bits x, y, z; at least one) are the
    /// chunk's first; more may be there. Throws what ChunkSource::decode throws.
    ChunkNodes nodes(const ArrayInfo& array, const Int3& chunk, unsigned low);
    /// What has node p, counted from the chunk's first: its sides, if p is in them and the chunk is
    /// not there and finds no room. Throws what ChunkSource::decode throws.
    ChunkPart part(const ArrayInfo& array, const Int3& chunk, const Int3& p);
    /// The element of node p in such a part; null if it is not there.
    [[nodiscard]] const std::byte* find(const ArrayInfo& array, const ChunkPart& part,
                                        const Int3& p) const;
    /// Of this chunk only its sides are needed from now on: the rest is dropped, unless somebody
    /// holds it. get() decodes it again.
    void keep_sides(const ArrayInfo& array, const Int3& chunk);
    /// Largest number of bytes that were alive at any time.
    [[nodiscard]] std::uint64_t peak_bytes() const;
    /// Chunks that this cache had decoded, those decoded twice counted twice, and their stored
    /// bytes.
    [[nodiscard]] std::uint64_t chunks_read() const;
    [[nodiscard]] std::uint64_t bytes_read() const;

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
    DecodedChunk decode(const ArrayInfo& array, const Int3& chunk,
                        std::unique_lock<std::mutex>& lock);
    DecodedChunk copy_sides(const ArrayInfo& array, const std::byte* whole) const;

    const ChunkSource& source_;
    std::uint64_t budget_;
    ChunkSides sides_;
    mutable std::mutex mutex_;
    std::condition_variable decoded_;
    Entries entries_;  ///< by row of the chunk table, twice; plus 1 for the sides alone
    std::list<std::uint64_t> order_;  ///< least recently used first
    std::uint64_t bytes_ = 0;
    std::uint64_t peak_ = 0;
    std::uint64_t chunks_read_ = 0;
    std::uint64_t bytes_read_ = 0;
};

}  // namespace isonest::detail
