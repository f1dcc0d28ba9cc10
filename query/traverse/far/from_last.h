// A loop from the last to the first, on all threads.
#pragma once

#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <cstddef>

namespace isonest::detail {

/// Calls work(i) for i from `count` - 1 down to 0, on all threads of the arena.
template <class Work>
void from_last(std::size_t count, const Work& work) {
    std::atomic<std::size_t> left{count};
    const auto take = [&] {
        while (!tbb::is_current_task_group_canceling()) {
            std::size_t next = left.load();
            while (next > 0 && !left.compare_exchange_weak(next, next - 1)) {
            }
            if (next == 0) {
                return;
            }
            work(next - 1);
        }
    };
    const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
    tbb::task_group group;
    for (std::size_t t = 0; t < std::min(threads, count); ++t) {
        group.run(take);
    }
    group.wait();
}

}  // namespace isonest::detail
