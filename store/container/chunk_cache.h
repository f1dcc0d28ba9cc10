// Cache of decoded chunks with a byte budget, boxes of values gathered from them, and prefetching
// in a known order.
#pragma once

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "store/base/box.h"
#include "store/container/chunk_source.h"

namespace isonest::detail {

/// The decoded bytes of one chunk; valid while held, even after eviction from the cache.
using DecodedChunk = std::shared_ptr<const std::byte[]>;

/// Some nodes of a decoded chunk: the node at p, relative to the chunk's first node, is element p .
/// stride.
struct ChunkNodes {
    DecodedChunk data;
    Int3 stride;
};

/// The nodes of a chunk that its neighbours need: the first `low` and the last `high` along each
/// axis.
struct ChunkSides {
    std::int64_t low = 1;
    std::int64_t high = 0;
};

/// A decoded chunk, or only its sides.
struct ChunkPart {
    DecodedChunk data;
    bool is_whole = false;
};

/// A chunk that is needed soon: all of it, or only nodes in its sides.
struct NeededChunk {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
    bool whole = true;
};

/// Least-recently-used cache over a ChunkSource. A chunk is decoded outside the lock by the first
/// thread that requests it; other threads wait. Chunks held by callers count against the budget
/// until they are released, and may exceed it: the callers must limit how many they hold. One chunk
/// per thread that is decoded for its sides may also exceed it.
/// Thread-safety: all methods from any thread.
class ChunkCache {
  public:
    /// Bytes of an entry in addition to its nodes.
    static constexpr std::uint64_t kEntryOverhead = 192;

    ChunkCache(const ChunkSource& source, std::uint64_t budget_bytes, const ChunkSides& sides = {})
        : source_(source), budget_(budget_bytes), sides_(sides) {}
    ChunkCache(const ChunkCache&) = delete;
    ChunkCache& operator=(const ChunkCache&) = delete;

    [[nodiscard]] const ChunkSource& source() const { return source_; }
    [[nodiscard]] std::uint64_t budget() const { return budget_; }
    /// Prefetches those of the chunks that are not in the cache, in one call to the source. The
    /// others are marked as recently used. Throws what ChunkSource::prefetch_all throws.
    void prefetch(std::span<const NeededChunk> needed);
    /// The decoded chunk if it is in the cache; else null.
    [[nodiscard]] DecodedChunk peek(const ArrayInfo& array, const Int3& chunk) const;
    /// Throws what ChunkSource::decode throws.
    DecodedChunk get(const ArrayInfo& array, const Int3& chunk);
    /// The nodes that have the chunk's first coordinate along the axes in `low` (bits x, y, z; at
    /// least one); may include more nodes. Throws what ChunkSource::decode throws.
    ChunkNodes nodes(const ArrayInfo& array, const Int3& chunk, unsigned low);
    /// A part that contains node p, relative to the chunk's first node. It is the sides alone if
    /// they contain p, and the chunk is not in the cache and there is no room for it. Throws what
    /// ChunkSource::decode throws.
    ChunkPart part(const ArrayInfo& array, const Int3& chunk, const Int3& p);
    /// The element of node p in such a part; null if the part does not contain it.
    [[nodiscard]] const std::byte* find(const ArrayInfo& array, const ChunkPart& part,
                                        const Int3& p) const;
    /// From now on only the sides of this chunk are needed: the rest is dropped unless somebody
    /// holds it. get() decodes it again.
    void keep_sides(const ArrayInfo& array, const Int3& chunk);
    /// Maximum number of bytes that were alive at any time.
    [[nodiscard]] std::uint64_t peak_bytes() const;
    /// Number of chunks that this cache decoded, counting repetitions, and their stored bytes.
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
    Entries entries_;  ///< by twice the row of the chunk table; plus 1 for the sides alone
    std::list<std::uint64_t> order_;  ///< least recently used first
    std::uint64_t bytes_ = 0;
    std::uint64_t peak_ = 0;
    std::uint64_t chunks_read_ = 0;
    std::uint64_t bytes_read_ = 0;
};

// Gathers a box of a level's values from the chunks that contain it.

/// Fills `box` (lattice coordinates of the array's level) with component 0 of a one-component
/// array. Coordinates outside the lattice get the value of the nearest node. chunk_at(c) returns
/// the nodes of chunk c, at least those in the box, with stride 1 along x.
/// REQUIRES: the array's elements are of type T, and the box is not empty.
template <class T, class ChunkAt>
void gather_from(const ChunkAt& chunk_at, const ArrayInfo& array, Box<T>& box) {
    const Int3 last = array.nodes - Int3{1, 1, 1};
    const Int3 from = min(max(box.lo, {0, 0, 0}), last);
    const Int3 to = max(min(box.lo + box.size - Int3{1, 1, 1}, last), {0, 0, 0});
    const Int3 c0 = array.chunk_of(from);
    const Int3 c1 = array.chunk_of(to);
    // A box that lies completely outside is filled from the nearest nodes, `from` .. `to`, below.
    const auto place = [&](std::int64_t p, int axis) {
        return std::clamp(p, box.lo[axis], box.lo[axis] + box.size[axis] - 1);
    };
    for (std::int64_t cz = c0.z; cz <= c1.z; ++cz) {
        for (std::int64_t cy = c0.y; cy <= c1.y; ++cy) {
            for (std::int64_t cx = c0.x; cx <= c1.x; ++cx) {
                const ChunkNodes chunk = chunk_at(Int3{cx, cy, cz});
                const T* const data = reinterpret_cast<const T*>(chunk.data.get());
                const Int3 base = array.first_node({cx, cy, cz});
                const Int3 lo = max(base, from);
                const Int3 hi = min(base + array.chunk - Int3{1, 1, 1}, to);
                for (std::int64_t z = lo.z; z <= hi.z; ++z) {
                    for (std::int64_t y = lo.y; y <= hi.y; ++y) {
                        std::copy_n(
                            data + (lo.x - base.x) + (y - base.y) * chunk.stride.y +
                                (z - base.z) * chunk.stride.z,
                            hi.x - lo.x + 1,
                            box.row(place(y, 1), place(z, 2)) + (place(lo.x, 0) - box.lo.x));
                    }
                }
            }
        }
    }
    // Extend the border outward: along x in the existing rows, then whole rows, then planes.
    const Int3 first{place(from.x, 0), place(from.y, 1), place(from.z, 2)};
    const Int3 end{place(to.x, 0), place(to.y, 1), place(to.z, 2)};
    for (std::int64_t z = first.z; z <= end.z; ++z) {
        for (std::int64_t y = first.y; y <= end.y; ++y) {
            T* const row = box.row(y, z);
            std::fill(row, row + (first.x - box.lo.x), row[first.x - box.lo.x]);
            std::fill(row + (end.x - box.lo.x) + 1, row + box.size.x, row[end.x - box.lo.x]);
        }
        for (std::int64_t y = box.lo.y; y < box.lo.y + box.size.y; ++y) {
            if (y < first.y || y > end.y) {
                std::copy_n(box.row(std::clamp(y, first.y, end.y), z), box.size.x, box.row(y, z));
            }
        }
    }
    for (std::int64_t z = box.lo.z; z < box.lo.z + box.size.z; ++z) {
        if (z < first.z || z > end.z) {
            std::copy_n(box.row(box.lo.y, std::clamp(z, first.z, end.z)), box.size.x * box.size.y,
                        box.row(box.lo.y, z));
        }
    }
}

/// The same, reading through a cache.
template <class T>
void gather_values(ChunkCache& cache, const ArrayInfo& array, Box<T>& box) {
    const Int3 stride{1, array.chunk.x, array.chunk.x * array.chunk.y};
    gather_from(
        [&](const Int3& chunk) {
            return ChunkNodes{cache.get(array, chunk), stride};
        },
        array, box);
}

/// Components `first` to `first + count - 1` of the `size` nodes starting at `lo`,
/// [z][y][x][component]. REQUIRES: the nodes lie in the array's lattice; its elements are of type
/// T.
template <class T>
std::vector<T> gather_components(ChunkCache& cache, const ArrayInfo& array, const Int3& lo,
                                 const Int3& size, int first, int count) {
    std::vector<T> out(static_cast<std::size_t>(size.product() * count));
    const Int3 c0 = array.chunk_of(lo);
    const Int3 chunks = array.chunk_of(lo + size - Int3{1, 1, 1}) - c0 + Int3{1, 1, 1};
    for (std::int64_t c = 0; c < chunks.product(); ++c) {
        const Int3 which = c0 + chunks.unlinear(c);
        const DecodedChunk chunk = cache.get(array, which);
        const T* const data = reinterpret_cast<const T*>(chunk.get());
        const Int3 base = array.first_node(which);
        const Int3 from = max(base, lo);
        const Int3 n = min(base + array.chunk, lo + size) - from;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 p = from + n.unlinear(i);
            std::copy_n(data + array.chunk.linear(p - base) * array.components + first, count,
                        out.begin() + size.linear(p - lo) * count);
        }
    }
    return out;
}

// The chunks that a piece of work needs, each once, collected before any is decoded.

/// Not thread-safe.
class ChunkNeeds {
  public:
    /// Chunks outside the array's grid are ignored. `whole`: false if only nodes in the sides are
    /// needed.
    void add(const ArrayInfo& array, const Int3& chunk, bool whole = true) {
        if (!array.has_chunk(chunk)) {
            return;
        }
        const auto [found, is_new] = places_.try_emplace(array.row_of(chunk), chunks_.size());
        if (is_new) {
            chunks_.push_back({&array, chunk, whole});
            bytes_ += bytes_of(array);
        } else if (whole) {
            chunks_[found->second].whole = true;
        }
    }
    void add(const ChunkNeeds& others) {
        for (const NeededChunk& c : others.chunks_) {
            add(*c.array, c.chunk, c.whole);
        }
    }
    [[nodiscard]] bool contains(const ArrayInfo& array, const Int3& chunk) const {
        return places_.contains(array.row_of(chunk));
    }
    /// The bytes that `others` would add to bytes().
    [[nodiscard]] std::uint64_t more_bytes(const ChunkNeeds& others) const {
        std::uint64_t more = 0;
        for (const NeededChunk& c : others.chunks_) {
            more += places_.contains(c.array->row_of(c.chunk)) ? 0 : bytes_of(*c.array);
        }
        return more;
    }
    /// The chunks in the order in which they were added.
    [[nodiscard]] std::span<const NeededChunk> chunks() const { return chunks_; }
    /// Bytes of all chunks, decoded and in a cache.
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    /// Approximate heap of this object.
    [[nodiscard]] std::uint64_t heap() const { return kHeapOfOne * chunks_.size(); }

  private:
    static constexpr std::uint64_t kHeapOfOne = 128;
    static std::uint64_t bytes_of(const ArrayInfo& array) {
        return array.chunk_bytes() + ChunkCache::kEntryOverhead;
    }

    std::vector<NeededChunk> chunks_;
    std::unordered_map<std::uint64_t, std::size_t> places_;  ///< by row of the chunk table
    std::uint64_t bytes_ = 0;
};

// Reading from a remote store in a known order: the next chunks are prefetched ahead of the reader.

/// For work on items 0, 1, 2 ..., each of which reads some chunks. The items are divided into
/// windows of about kWindow decoded bytes; when the first item of a window is reached, the next
/// window is prefetched. Does nothing if the source is not remote. Thread-safety: reach() from any
/// thread.
class Prefetcher {
  public:
    /// Adds the chunks that an item reads; may include chunks outside the array's grid.
    using Wanted = std::function<void(std::int64_t item, std::vector<WantedChunk>& chunks)>;

    /// Items from `begin` to `end`. `source` must outlive it.
    Prefetcher(const ChunkSource& source, std::int64_t begin, std::int64_t end, Wanted wanted)
        : source_(source), wanted_(std::move(wanted)), prefetched_(begin), next_at_(begin) {
        end_ = source.is_remote() ? end : begin;
    }
    /// The same for work that reads through a cache: chunks in the cache are not prefetched.
    Prefetcher(ChunkCache& cache, std::int64_t begin, std::int64_t end, Wanted wanted)
        : Prefetcher(cache.source(), begin, end, std::move(wanted)) {
        cache_ = &cache;
    }
    Prefetcher(const Prefetcher&) = delete;
    Prefetcher& operator=(const Prefetcher&) = delete;

    /// Must be called before this item is read. Throws what ChunkSource::prefetch_all throws.
    void reach(std::int64_t item) {
        const std::lock_guard lock(mutex_);
        while (prefetched_ < end_ && item >= next_at_) {
            next_at_ = prefetched_;
            prefetch_window();
        }
    }

  private:
    static constexpr std::uint64_t kWindow = 8U << 20U;

    void prefetch_window() {
        std::vector<WantedChunk> chunks;
        std::uint64_t bytes = 0;
        std::size_t seen = 0;
        while (prefetched_ < end_ && bytes < kWindow) {
            wanted_(prefetched_++, chunks);
            for (; seen < chunks.size(); ++seen) {
                bytes += chunks[seen].array->chunk_bytes();
            }
        }
        if (cache_ == nullptr) {
            source_.prefetch_all(chunks);
            return;
        }
        ChunkNeeds needs;
        for (const WantedChunk& chunk : chunks) {
            needs.add(*chunk.array, chunk.chunk);
        }
        cache_->prefetch(needs.chunks());
    }

    const ChunkSource& source_;
    ChunkCache* cache_ = nullptr;
    std::int64_t end_ = 0;
    Wanted wanted_;
    std::mutex mutex_;
    std::int64_t prefetched_;  ///< items before this one have been prefetched
    std::int64_t next_at_;     ///< reaching this item prefetches the next window
};

/// Calls work(item) for all items from `begin` to `end`, on all threads of the arena. If the source
/// is remote, in ascending order, so that the chunks can be prefetched; else as tbb::parallel_for
/// does. Throws what the calls throw.
template <class Work>
void for_each_prefetched(const ChunkSource& source, Prefetcher& prefetcher, std::int64_t begin,
                         std::int64_t end, const Work& work) {
    if (!source.is_remote()) {
        tbb::parallel_for(begin, end, work);
        return;
    }
    std::atomic<std::int64_t> next{begin};
    const auto take = [&] {
        for (std::int64_t item = next++; item < end && !tbb::is_current_task_group_canceling();
             item = next++) {
            prefetcher.reach(item);
            work(item);
        }
    };
    tbb::task_group group;
    const std::int64_t threads = tbb::this_task_arena::max_concurrency();
    for (std::int64_t t = 0; t < std::min(threads, end - begin); ++t) {
        group.run(take);
    }
    group.wait();
}

/// For Prefetcher::Wanted: adds the chunks of an array that contain nodes `lo` to `hi`, or the
/// nearest nodes.
inline void want_box(const ArrayInfo& array, const Int3& lo, const Int3& hi,
                     std::vector<WantedChunk>& chunks) {
    const Int3 last = array.nodes - Int3{1, 1, 1};
    const Int3 from = array.chunk_of(min(max(lo, {0, 0, 0}), last));
    const Int3 size = array.chunk_of(max(min(hi, last), {0, 0, 0})) - from + Int3{1, 1, 1};
    for (std::int64_t i = 0; i < size.product(); ++i) {
        chunks.push_back({&array, from + size.unlinear(i)});
    }
}

}  // namespace isonest::detail
