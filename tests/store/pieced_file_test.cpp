// Temporary space in pieces: the map shows what was written, and a piece is removed when all of it
// was released, by any threads.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <span>
#include <thread>
#include <vector>

#include "store/files/scratch_file.h"
#include "tests/support/test_support.h"

using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kStep = 4096 * 3 + 1;  // so that some ranges lie in two pieces
constexpr std::uint64_t kBytes = 5000000;
constexpr unsigned kThreads = 4;

std::byte byte_at(std::uint64_t offset) {
    return static_cast<std::byte>((offset * 0x9E3779B97F4A7C15ULL) >> 56U);
}

std::vector<std::byte> bytes_at(std::uint64_t offset, std::uint64_t count) {
    std::vector<std::byte> bytes(count);
    for (std::uint64_t i = 0; i < count; ++i) {
        bytes[i] = byte_at(offset + i);
    }
    return bytes;
}

std::ptrdiff_t open_files() {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"),
                         std::filesystem::directory_iterator());
}

/// Calls f(offset, bytes) for all ranges of kStep, distributed to threads in turn.
template <class F>
void in_threads(const F& f) {
    std::vector<std::thread> threads;
    for (unsigned t = 0; t < kThreads; ++t) {
        threads.emplace_back([t, &f] {
            for (std::uint64_t at = t * kStep; at < kBytes; at += kThreads * kStep) {
                f(at, std::min(kStep, kBytes - at));
            }
        });
    }
    for (std::thread& thread : threads) {
        thread.join();
    }
}

}  // namespace

TEST_CASE("a piece is removed when several threads have released all of it, and not before") {
    const TemporaryFolder folder;
    const std::ptrdiff_t before = open_files();
    PiecedFile file{ScratchFolder(folder.path())};
    in_threads(
        [&](std::uint64_t at, std::uint64_t count) { file.write_at(at, bytes_at(at, count)); });
    const std::span<const std::byte> map = file.map(kBytes);
    const std::ptrdiff_t pieces = open_files() - before;
    REQUIRE(pieces > 8);

    // All but the first byte of each range; so no piece is complete.
    in_threads([&](std::uint64_t at, std::uint64_t count) { file.release(at + 1, count - 1); });
    CHECK(open_files() == before + pieces);
    std::uint64_t wrong = 0;
    for (std::uint64_t at = 0; at < kBytes; at += kStep) {
        wrong += map[at] == byte_at(at) ? 0 : 1;
    }
    CHECK(wrong == 0);

    in_threads([&](std::uint64_t at, std::uint64_t /*count*/) { file.release(at, 1); });
    CHECK(open_files() == before);
}

TEST_CASE("a piece that is released as a whole does not affect its neighbours") {
    const TemporaryFolder folder;
    PiecedFile file{ScratchFolder(folder.path())};
    file.write_at(0, bytes_at(0, kBytes));
    const std::span<const std::byte> map = file.map(kBytes);
    constexpr std::uint64_t kPiece = std::uint64_t{1} << 18U;
    const std::ptrdiff_t all = open_files();
    file.release(kPiece, kPiece);
    CHECK(open_files() == all - 1);
    std::uint64_t wrong = 0;
    for (std::uint64_t at = 0; at < kBytes; ++at) {
        wrong += at / kPiece == 1 || map[at] == byte_at(at) ? 0 : 1;
    }
    CHECK(wrong == 0);
}
