#include <algorithm>
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <map>

#include <isonest/error.h>

#include "store/ranks/agreement.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using detail::Communicator;
using test::ThreadRanks;

TEST_CASE("every rank gets what the others send it, in each sender's order") {
    for (const int size : {1, 2, 3, 7}) {
        std::atomic<int> taken = 0;
        ThreadRanks(size).run([&](Communicator& ranks) {
            constexpr int kEach = 5;
            int sent = 0;
            std::map<int, int> next;
            ranks.exchange(
                [&](Communicator::Message& message) {
                    if (sent == kEach * (size - 1)) {
                        return false;
                    }
                    const int other = sent / kEach;
                    message.to = other + (other >= ranks.rank() ? 1 : 0);
                    message.bytes = {static_cast<std::byte>(sent++ % kEach)};
                    return true;
                },
                static_cast<std::uint64_t>(kEach * (size - 1)),
                [&](int from, std::span<const std::byte> bytes) {
                    const bool in_order =
                        bytes.size() == 1 && static_cast<int>(bytes[0]) == next[from]++;
                    taken += in_order && from != ranks.rank() ? 1 : 0;
                });
        });
        CHECK(taken == 5 * size * (size - 1));
    }
}

TEST_CASE("all ranks get the sums and the maximums, and the text of rank 0") {
    for (const int size : {1, 2, 5}) {
        std::atomic<int> right = 0;
        ThreadRanks(size).run([&](Communicator& ranks) {
            std::array<std::uint64_t, 2> sums{1, static_cast<std::uint64_t>(ranks.rank())};
            ranks.sum(sums);
            std::array<double, 1> most{-1.0 * ranks.rank()};
            ranks.largest(most);
            const std::string text = ranks.broadcast(ranks.rank() == 0 ? "from 0" : "");
            const auto all = ranks.gather(std::to_string(ranks.rank()));
            ranks.meet();
            const auto count = static_cast<std::uint64_t>(size);
            const bool gathered =
                ranks.rank() != 0 ? all.empty()
                                  : all.size() == count && all.back() == std::to_string(size - 1);
            right += sums[0] == count && sums[1] == count * (count - 1) / 2 && most[0] == 0 &&
                             text == "from 0" && gathered
                         ? 1
                         : 0;
        });
        CHECK(right == size);
    }
}

TEST_CASE("ranks that wait end when another one fails") {
    std::atomic<int> ended = 0;
    CHECK_THROWS_AS(ThreadRanks(4).run([&](Communicator& ranks) {
        if (ranks.rank() == 2) {
            throw Error(ErrorKind::io, "no space");
        }
        try {
            ranks.meet();
        } catch (const Error& error) {
            ended += error.kind() == ErrorKind::cancelled ? 1 : 0;
        }
    }),
                    Error);
    CHECK(ended == 3);
}

TEST_CASE("rank 0 learns which ranks have a different text") {
    for (const int odd : {0, 1, 10}) {
        std::string told;
        std::atomic<int> silent = 0;
        ThreadRanks(12).run([&](Communicator& ranks) {
            const bool differs = ranks.rank() > 0 && ranks.rank() <= odd;
            const std::string found =
                detail::who_differs(ranks, differs ? "0.5.0" : "0.4.0", "0.4.0");
            if (ranks.rank() == 0) {
                told = found;
            } else {
                silent += found.empty() ? 1 : 0;
            }
        });
        CHECK(silent == 11);
        CHECK(told == (odd == 0   ? ""
                       : odd == 1 ? "1 (thread)"
                                  : "1 (thread), 2 (thread), 3 (thread), 4 (thread), 5 (thread), "
                                    "6 (thread), 7 (thread), 8 (thread) and 2 more"));
    }
}
