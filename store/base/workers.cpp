#include "store/base/workers.h"

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <latch>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/progress.h>

#include "store/base/memory.h"

namespace isonest::detail {

std::thread started_thread(const std::string& name, std::function<void()> work) {
    try {
        return std::thread(std::move(work));
    } catch (const std::system_error&) {
        throw Error(ErrorKind::limit, {name}, "the system cannot start another thread",
                    {{RemedyKind::raise_limit, "ulimit -u, ulimit -d, ulimit -v"}});
    }
}

void throw_if_no_room_to_load(const std::string& file, const std::string& whole,
                              std::string_view why) {
    const auto says = [why](std::string_view words) {
        return why.find(words) != std::string_view::npos;
    };
    // Messages of the C library (glibc, elf/dl-load.c, dl-map-segments.h and others).
    constexpr std::array<std::string_view, 7> kNoMemory{"cannot map zero-fill pages",
                                                        "failed to map segment",
                                                        "annot allocate memory",
                                                        "cannot allocate",
                                                        "out of memory",
                                                        "cannot create shared object",
                                                        "cannot create search path"};
    // A segment also cannot be mapped if its folder does not permit execution.
    const bool is_forbidden = says("not permitted") || says("ermission denied");
    if (!is_forbidden && std::any_of(kNoMemory.begin(), kNoMemory.end(), says)) {
        throw Error(ErrorKind::limit, {file},
                    fmt::format("not enough memory to load {} ({})", whole, why),
                    {{RemedyKind::raise_limit, "ulimit -d, ulimit -v"}});
    }
    if (says("Too many open files")) {
        throw Error(ErrorKind::limit, {file}, fmt::format("cannot load {} ({})", whole, why),
                    {{RemedyKind::raise_limit, "ulimit -n"}});
    }
}

void require_threads(int count) {
    // oneTBB 2022 (Debian 13) does not return if an arena finds no memory.
    require_free_heap(std::size_t{8} << 20U);
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
                    fmt::format("the system allows this run only {} of {} threads: {}", possible,
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
    constexpr std::chrono::seconds kPatience{1};
    const auto until = std::chrono::steady_clock::now() + kPatience;
    std::atomic<int> here{0};
    arena.execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<int>(0, count, 1),
            [&](const tbb::blocked_range<int>& /*one*/) {
                ++here;
                while (here < count && std::chrono::steady_clock::now() < until) {
                    std::this_thread::yield();
                }
            },
            tbb::simple_partitioner{});
    });
}

}  // namespace isonest::detail

namespace isonest {

void Progress::check() const {
    if (cancelled()) {
        throw Error(ErrorKind::cancelled, "interrupted; nothing was left behind");
    }
}

Progress& silent_progress() {
    static Progress instance;
    return instance;
}

}  // namespace isonest
