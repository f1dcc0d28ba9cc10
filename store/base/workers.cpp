#include "store/base/workers.h"

#include <fmt/format.h>

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

}  // namespace isonest::detail
