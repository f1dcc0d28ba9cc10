// Reading in a known order from a store behind a network: what comes next is announced ahead of who
// reads.
#pragma once

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <utility>
#include <vector>

#include "store/container/announce/chunk_needs.h"

namespace isonest::detail {

/// For work on items 0, 1, 2 ... of which each reads some chunks. The items lie in windows of about
/// kWindow decoded bytes; when the first item of a window is reached, the window after it is
/// announced. Nothing is done where the source is not far. Thread-safety: reach() from any thread.
class Announcer {
  public:
    /// Adds what an item reads; chunks outside the array's grid may be among it.
    using Wanted = std::function<void(std::int64_t item, std::vector<WantedChunk>& chunks)>;

    /// Items from `begin` to `end`. `source` must outlive it.
    Announcer(const ChunkSource& source, std::int64_t begin, std::int64_t end, Wanted wanted)
        : source_(source), wanted_(std::move(wanted)), announced_(begin), next_at_(begin) {
        end_ = source.is_far() ? end : begin;
    }
    /// The same where the work reads through a cache: what is in it is not announced.
    Announcer(ChunkCache& cache, std::int64_t begin, std::int64_t end, Wanted wanted)
        : Announcer(cache.source(), begin, end, std::move(wanted)) {
        cache_ = &cache;
    }
    Announcer(const Announcer&) = delete;
    Announcer& operator=(const Announcer&) = delete;

    /// Somebody is about to read this item. Throws what ChunkSource::prefetch_all throws.
    void reach(std::int64_t item) {
        const std::lock_guard lock(mutex_);
        while (announced_ < end_ && item >= next_at_) {
            next_at_ = announced_;
            announce_window();
        }
    }

  private:
    static constexpr std::uint64_t kWindow = 8U << 20U;

    void announce_window() {
        std::vector<WantedChunk> chunks;
        std::uint64_t bytes = 0;
        std::size_t seen = 0;
        while (announced_ < end_ && bytes < kWindow) {
            wanted_(announced_++, chunks);
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
        cache_->announce(needs.chunks());
    }

    const ChunkSource& source_;
    ChunkCache* cache_ = nullptr;
    std::int64_t end_ = 0;
    Wanted wanted_;
    std::mutex mutex_;
    std::int64_t announced_;  ///< items before it are
    std::int64_t next_at_;    ///< when this one is reached, the next window is to be
};

/// Calls work(item) for all items from `begin` to `end`, on all threads of the arena: in ascending
/// order where the source is far, so that what they read can be announced; else as
/// tbb::parallel_for does. Throws what they throw.
template <class Work>
void for_each_announced(const ChunkSource& source, Announcer& announcer, std::int64_t begin,
                        std::int64_t end, const Work& work) {
    if (!source.is_far()) {
        tbb::parallel_for(begin, end, work);
        return;
    }
    std::atomic<std::int64_t> next{begin};
    const auto take = [&] {
        for (std::int64_t item = next++; item < end && !tbb::is_current_task_group_canceling();
             item = next++) {
            announcer.reach(item);
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

/// For Announcer::Wanted: the chunks of an array that hold nodes `lo` to `hi`, or the nearest ones.
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
