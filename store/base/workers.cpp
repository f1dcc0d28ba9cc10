#include "store/base/workers.h"

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <latch>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include <isonest/error.h>

namespace isonest::detail {
void require_threads(int count) {
    std::latch done(1);
    std::vector<std::thread> threads;
    threads.reserve(static_cast<std::size_t>(count));
    int reason = 0;
    try {
        while (static_cast<int>(threads.size()) + 1 < count) {
            threads.emplace_back([&done] { done.wait(); });
        }
    } catch (const std::system_error& error) {
        reason = error.code().value();
    }
    done.count_down();
    for (std::thread& thread : threads) {
        thread.join();
    }
    if (reason != 0) {
        const std::size_t possible = threads.size() + 1;
        throw Error(ErrorKind::limit,
                    fmt::format("the system lets this run have {} of {} threads: {}", possible,
                                count, std::system_category().message(reason)),
                    {{RemedyKind::fewer_threads, std::to_string(possible)},
                     {RemedyKind::raise_limit, "ulimit -u, ulimit -v"}});
    }
}

void start_threads_where_memory_is_limited(tbb::task_arena& arena, int count) {
    const auto limited = [](auto which) {
        rlimit limit{};
        return ::getrlimit(which, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY;
    };
    if (count < 2 || (!limited(RLIMIT_AS) && !limited(RLIMIT_DATA))) {
        return;
    }
    constexpr std::chrono::milliseconds kPatience{200};
    std::atomic<int> here{0};
    arena.execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<int>(0, count, 1),
            [&](const tbb::blocked_range<int>& /*one*/) {
                const auto until = std::chrono::steady_clock::now() + kPatience;
                ++here;
                while (here < count && std::chrono::steady_clock::now() < until) {
                    std::this_thread::yield();
                }
            },
            tbb::simple_partitioner{});
    });
}

}  // namespace isonest::detail
