// MPI ranks that exchange messages of all sizes, many at a time, and then end well or fail:
//
//     mpirun -n N isonest_mpi_exchange ok|throw RANK|throw-all|wait RANK
//
// ok: every message arrives once and complete, and collectives agree. throw: that rank fails while
// all others wait for it. throw-all: all fail. wait: that rank works without messages, the others
// fail. Rank 0 prints the results; exits with the code of the outcome.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "tools/mpi/mpi_communicator.h"

namespace {

using isonest::Error;
using isonest::ErrorKind;
using isonest::detail::Communicator;
using isonest::detail::MpiCommunicator;

constexpr int kRounds = 20;

/// Number of bytes of the `i`th message in a round from one rank to another.
std::size_t size_of(int round, int from, int to, int i) {
    std::mt19937 random(static_cast<unsigned>(((round * 64 + from) * 64 + to) * 64 + i));
    const std::uint64_t shift = random() % 21;
    return random() % ((std::uint64_t{1} << shift) + 1);
}
int count_of(int round, int from, int to) {
    return static_cast<int>(size_of(round, from, to, 63) % 5);
}
std::byte byte_of(std::size_t size, std::size_t at) {
    return static_cast<std::byte>((size * 31 + at * 7) & 0xFFU);
}

void exchange_once(Communicator& ranks, int round) {
    const int own = ranks.rank();
    std::uint64_t expected = 0;
    for (int r = 0; r < ranks.size(); ++r) {
        expected += r == own ? 0 : static_cast<std::uint64_t>(count_of(round, r, own));
    }
    int to = 0;
    int sent = 0;
    std::vector<int> taken(static_cast<std::size_t>(ranks.size()), 0);
    ranks.exchange(
        [&](Communicator::Message& message) {
            while (to < ranks.size() && (to == own || sent == count_of(round, own, to))) {
                ++to;
                sent = 0;
            }
            if (to == ranks.size()) {
                return false;
            }
            message.to = to;
            const std::size_t size = size_of(round, own, to, sent++);
            message.bytes.resize(size);
            for (std::size_t i = 0; i < size; ++i) {
                message.bytes[i] = byte_of(size, i);
            }
            return true;
        },
        expected,
        [&](int from, std::span<const std::byte> bytes) {
            const std::size_t size =
                size_of(round, from, own, taken[static_cast<std::size_t>(from)]++);
            if (bytes.size() != size) {
                throw Error(ErrorKind::corrupt,
                            fmt::format("{} bytes in place of {}", bytes.size(), size));
            }
            for (std::size_t i = 0; i < size; ++i) {
                if (bytes[i] != byte_of(size, i)) {
                    throw Error(ErrorKind::corrupt, "other bytes");
                }
            }
        });
}

void work(Communicator& ranks, const std::string& how, int which) {
    for (int round = 0; round < kRounds; ++round) {
        if (round == kRounds / 2) {
            if (how == "throw-all" || (how == "throw" && ranks.rank() == which) ||
                (how == "wait" && ranks.rank() != which)) {
                throw Error(ErrorKind::io, fmt::format("failed at {}", ranks.rank()));
            }
            while (how == "wait") {  // work that checks now and then whether to stop
                ::usleep(1000);
                ranks.check();
            }
        }
        exchange_once(ranks, round);
    }
    std::vector<std::uint64_t> numbers{1, static_cast<std::uint64_t>(ranks.rank())};
    ranks.sum(numbers);
    const auto size = static_cast<std::uint64_t>(ranks.size());
    if (numbers[0] != size || numbers[1] != size * (size - 1) / 2) {
        throw Error(ErrorKind::corrupt, "other sums");
    }
}

}  // namespace

int main(int argc, char** argv) {
    MpiCommunicator ranks(argc, argv, [] { return false; });
    const std::string how = argc > 1 ? argv[1] : "ok";
    MpiCommunicator::Ending own;
    try {
        work(ranks, how, argc > 2 ? std::atoi(argv[2]) : 0);
    } catch (const Error& error) {
        own = {static_cast<int>(error.kind()), error.what(), "", false};
        own.is_consequence = error.kind() == ErrorKind::cancelled;
    }
    int who = 0;
    const MpiCommunicator::Ending verdict = ranks.agree(own, who);
    if (ranks.rank() == 0) {
        fmt::print("{}\n", verdict.has_failed() ? fmt::format("rank {}: {}", who, verdict.message)
                                                : "all is well");
    }
    return verdict.exit_code;
}
