#include "store/base/workers.h"

#include <fmt/format.h>

#include <cstddef>
#include <latch>
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
        throw Error(ErrorKind::limit,
                    fmt::format("the system lets this run have {} of {} threads: {}; give "
                                "--threads {} or raise the limit (ulimit -u, ulimit -v)",
                                threads.size() + 1, count, std::system_category().message(reason),
                                threads.size() + 1));
    }
}

}  // namespace isonest::detail
