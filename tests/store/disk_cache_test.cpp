// The cache of ranges on disk: it returns what was kept, whatever happens to its files and to the
// processes that write them, and its size stays within the limit.
#include "store/bytes/disk_cache.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <isonest/error.h>

#include "tests/support/sanitized.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kBlock = CachedBlock::kBytes;
constexpr std::uint64_t kObjectBytes = 40 * kBlock + 1234;
constexpr std::uint64_t kPlenty = std::uint64_t{1} << 30U;

ObjectState object_state(const std::string& version = "\"abc\"") {
    return {"https://host.example/scans/bucky.isonest", version, kObjectBytes};
}

/// The bytes of an object: two objects differ in every byte.
std::vector<std::byte> object_bytes(ByteRange range, unsigned object = 0) {
    std::vector<std::byte> bytes(range.size);
    for (std::uint64_t i = 0; i < range.size; ++i) {
        const std::uint64_t h = (range.offset + i) * 0x9E3779B97F4A7C15ULL;
        bytes[i] = static_cast<std::byte>((h >> 56U) + object);
    }
    return bytes;
}

void keep(RangeCache& cache, ByteRange range, unsigned object = 0) {
    cache.keep(range, object_bytes(range, object));
}

bool has(RangeCache& cache, ByteRange range, unsigned object = 0) {
    const auto found = cache.load(range);
    if (found) {
        REQUIRE((*found == object_bytes(range, object)));
    }
    return found.has_value();
}

std::vector<std::filesystem::path> files_below(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> files;
    std::error_code ignored;
    for (auto at = std::filesystem::recursive_directory_iterator(folder, ignored);
         at != std::filesystem::recursive_directory_iterator(); at.increment(ignored)) {
        if (at->is_regular_file(ignored)) {
            files.push_back(at->path());
        }
    }
    return files;
}

bool is_entry(const std::filesystem::path& file) {
    return file.filename().string().size() == 14 &&
           file.parent_path().filename().string().size() == 2;
}

std::vector<std::filesystem::path> entries_below(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> files = files_below(folder);
    std::erase_if(files, [](const auto& file) { return !is_entry(file); });
    return files;
}

/// The space that they take on disk.
std::uint64_t bytes_of_entries(const std::filesystem::path& folder) {
    std::uint64_t sum = 0;
    for (const auto& file : entries_below(folder)) {
        std::error_code ignored;
        const std::uintmax_t size = std::filesystem::file_size(file, ignored);
        sum += ignored ? 0 : (size + 4095) / 4096 * 4096;
    }
    return sum;
}

ByteRange random_range(std::mt19937_64& random) {
    const std::uint64_t size = 1 + random() % (3 * kBlock);
    return {random() % (kObjectBytes - size), size};
}

/// Keeps and loads ranges of two objects, until `until`. Returns false if a byte was wrong.
bool use_cache(const std::filesystem::path& folder, std::uint64_t most, unsigned seed,
               std::chrono::steady_clock::time_point until) {
    const DiskCache cache(folder, most);
    std::mt19937_64 random(seed);
    const auto first = cache.of(object_state("1"));
    const auto second = cache.of(object_state("2"));
    for (unsigned i = 0; std::chrono::steady_clock::now() < until; ++i) {
        const unsigned object = i % 2;
        RangeCache& ranges = object == 0 ? *first : *second;
        const ByteRange range = random_range(random);
        if (const auto found = ranges.load(range)) {
            if (*found != object_bytes(range, object)) {
                return false;
            }
        } else {
            keep(ranges, range, object);
        }
    }
    return cache.warning().empty();
}

/// Starts a process that runs f() and exits with 0 if it returns true.
pid_t start_process(const std::function<bool()>& f) {
    const pid_t child = ::fork();
    if (child == 0) {
        bool good = false;
        try {
            good = f();
        } catch (...) {
            good = false;
        }
        ::_exit(good ? 0 : 1);
    }
    REQUIRE(child > 0);
    return child;
}

/// Waits for the process; returns its status as waitpid() gives it.
int wait_for(pid_t child) {
    int status = 0;
    REQUIRE(::waitpid(child, &status, 0) == child);
    return status;
}

void make_older(const std::filesystem::path& file, std::chrono::seconds by) {
    std::filesystem::last_write_time(file, std::filesystem::last_write_time(file) - by);
}

std::chrono::steady_clock::time_point in(std::chrono::milliseconds time) {
    return std::chrono::steady_clock::now() + time;
}

}  // namespace

TEST_CASE("the last known state of an object is returned until it is damaged") {
    const TemporaryFolder dir;
    const DiskCache cache(dir.path(), kPlenty);
    const ObjectState asked{object_state().url, "", 0};
    CHECK_FALSE(cache.last_of(asked));
    cache.remember(object_state());
    cache.remember(object_state("\"later\""));
    const std::optional<ObjectState> found = DiskCache(dir.path(), kPlenty).last_of(asked);
    REQUIRE(found);
    CHECK(found->version == "\"later\"");
    CHECK(found->size == kObjectBytes);
    CHECK(found->url == asked.url);
    CHECK_FALSE(cache.last_of({asked.url + "x", "", 0}));
    CHECK_FALSE(cache.last_of({asked.url, "", 0, "a query"}));
    for (const auto& entry : std::filesystem::recursive_directory_iterator(dir.path())) {
        if (entry.is_regular_file() && entry.file_size() > 16) {
            std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
            file.seekp(-1, std::ios::end);
            file.put('~');
        }
    }
    CHECK_FALSE(cache.last_of(asked));
}

TEST_CASE("what is forgotten is no longer returned, and other bytes can be kept in its place") {
    const TemporaryFolder dir;
    const DiskCache cache(dir.path(), kPlenty);
    const auto object = cache.of(object_state());
    keep(*object, {100, 3 * kBlock}, 1);
    CHECK(has(*object, {200, kBlock}, 1));
    object->forget({kBlock + 50, 100});
    CHECK_FALSE(object->load({kBlock, 51}));
    CHECK_FALSE(object->load({kBlock + 149, 10}));
    CHECK(has(*object, {100, kBlock - 50}, 1));
    CHECK(has(*object, {kBlock + 150, 1000}, 1));
    object->forget({kObjectBytes, 5});  // an empty range
    object->forget({kBlock, kBlock});   // a whole block
    CHECK_FALSE(object->load({2 * kBlock - 1, 1}));
    CHECK(has(*object, {2 * kBlock, 100}, 1));
    keep(*object, {kBlock, 1000});
    CHECK(has(*object, {kBlock, 1000}));
    CHECK_FALSE(object->load({kBlock + 900, 200}));
    // Bytes added to a block that was just read are there.
    keep(*object, {kBlock + 1000, 1000});
    CHECK(has(*object, {kBlock, 2000}));
}

TEST_CASE("a block has exactly the bytes that were added") {
    std::mt19937_64 random(5);
    for (int round = 0; round < 30; ++round) {
        CachedBlock block;
        std::vector<bool> is_there(kBlock);
        const std::vector<std::byte> all = object_bytes({0, kBlock});
        const std::uint64_t longest = 1 + random() % (round % 3 == 0 ? 50 : 20'000);
        for (int step = 0; step < 60; ++step) {
            const std::uint64_t size = random() % (longest + 1);
            const std::uint64_t from = random() % (kBlock - size + 1);
            const auto begin = is_there.begin() + static_cast<std::ptrdiff_t>(from);
            const auto end = begin + static_cast<std::ptrdiff_t>(size);
            const bool is_new = std::find(begin, end, false) != end;
            if (step % 2 == 0) {
                REQUIRE(block.add(from, std::span(all).subspan(from, size)) == is_new);
                std::fill(begin, end, true);
            } else {
                std::vector<std::byte> to(size);
                REQUIRE(block.copy(from, to) == !is_new);
                REQUIRE((is_new || std::equal(to.begin(), to.end(), all.begin() + from)));
            }
            if (step % 10 == 9) {
                const auto again = CachedBlock::decode(block.encode("name", 7), "name", 7);
                REQUIRE(again);
                block = *again;
            }
        }
    }
}

TEST_CASE("a block's file is refused under another name or number, and if any bit is damaged") {
    CachedBlock block;
    block.add(10, object_bytes({10, 40}));
    block.add(100, object_bytes({100, 7}));
    const std::vector<std::byte> file = block.encode("name", 7);
    REQUIRE(CachedBlock::decode(file, "name", 7));
    CHECK_FALSE(CachedBlock::decode(file, "name", 8));
    CHECK_FALSE(CachedBlock::decode(file, "nama", 7));
    CHECK_FALSE(CachedBlock::decode(file, "name2", 7));
    for (std::size_t bit = 0; bit < file.size() * 8; ++bit) {
        std::vector<std::byte> changed = file;
        changed[bit / 8] ^= std::byte{1} << (bit % 8);
        CAPTURE(bit);
        REQUIRE_FALSE(CachedBlock::decode(changed, "name", 7));
    }
    for (std::size_t size = 0; size < file.size(); ++size) {
        REQUIRE_FALSE(CachedBlock::decode(std::span(file).first(size), "name", 7));
    }
    std::vector<std::byte> longer = file;
    longer.push_back(std::byte{0});
    CHECK_FALSE(CachedBlock::decode(longer, "name", 7));
    CHECK(block.encode(std::string(3 * kBlock, 'x'), 7).empty());
    CHECK(CachedBlock::decode(CachedBlock().encode("name", 7), "name", 7));
}

TEST_CASE("kept ranges are found, joined with neighbours or not, by this and later runs") {
    const TemporaryFolder folder;
    const auto path = folder / "a" / "cache";
    {
        const DiskCache cache(path, kPlenty);
        const auto ranges = cache.of(object_state());
        REQUIRE(ranges);
        CHECK_FALSE(ranges->load({0, 1}));
        CHECK(ranges->load({5, 0}));
        keep(*ranges, {100, 1000});
        keep(*ranges, {1100, 3 * kBlock});  // adjacent to the first
        keep(*ranges, {kObjectBytes - 10, 10});
        keep(*ranges, {10 * kBlock, kBlock});
        CHECK(cache.warning().empty());
    }
    const DiskCache cache(path, kPlenty);
    const auto ranges = cache.of(object_state());
    CHECK(has(*ranges, {100, 1000 + 3 * kBlock}));
    CHECK(has(*ranges, {600, 1000}));
    CHECK(has(*ranges, {kBlock - 1, 2}));
    CHECK(has(*ranges, {10 * kBlock + 3, 17}));
    CHECK(has(*ranges, {kObjectBytes - 1, 1}));
    CHECK_FALSE(has(*ranges, {99, 2}));
    CHECK_FALSE(has(*ranges, {1100 + 3 * kBlock - 1, 2}));
    CHECK_FALSE(has(*ranges, {10 * kBlock - 1, 2}));
    // Nothing is found outside the object.
    CHECK_FALSE(ranges->load({kObjectBytes - 1, 2}));
    CHECK_FALSE(ranges->load({kObjectBytes + 1, 0}));
    CHECK_FALSE(ranges->load({~std::uint64_t{0}, 2}));
    CHECK_FALSE(ranges->load({2, ~std::uint64_t{0}}));
    keep(*ranges, {kObjectBytes - 1, 2});
    ranges->keep({20 * kBlock, 5}, object_bytes({20 * kBlock, 4}));
    CHECK_FALSE(has(*ranges, {20 * kBlock, 4}));
}

TEST_CASE("ranges kept by several threads at the same time are all found afterwards") {
    const TemporaryFolder folder;
    const DiskCache cache(folder.path(), kPlenty);
    const auto ranges = cache.of(object_state());
    constexpr std::uint64_t kPiece = 10'007;  // six per block, and across borders
    std::atomic<std::uint64_t> next = 0;
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
        threads.emplace_back([&] {
            for (std::uint64_t at = next++; (at + 1) * kPiece <= kObjectBytes; at = next++) {
                keep(*ranges, {at * kPiece, kPiece});
            }
        });
    }
    for (std::thread& thread : threads) {
        thread.join();
    }
    const std::uint64_t pieces = kObjectBytes / kPiece;
    CHECK(has(*ranges, {0, pieces * kPiece}));
    CHECK_FALSE(has(*ranges, {pieces * kPiece - 1, 2}));
}

TEST_CASE("a range kept while its block is being loaded is found afterwards") {
    const TemporaryFolder folder;
    const DiskCache cache(folder.path(), kPlenty);
    const auto ranges = cache.of(object_state());
    const ByteRange first{0, 1000};
    const ByteRange second{5000, 1000};
    int missing = 0;
    const bool is_damaged = GENERATE(false, true);
    for (int turn = 0; turn < 500; ++turn) {
        ranges->forget({0, kBlock});
        keep(*ranges, first);
        if (is_damaged) {
            const std::filesystem::path entry = entries_below(folder.path()).at(0);
            std::filesystem::resize_file(entry, std::filesystem::file_size(entry) - 1);
        }
        std::atomic<bool> begins = false;
        std::thread loading([&] {
            begins = true;
            (void)ranges->load(first);
        });
        while (!begins) {
        }
        keep(*ranges, second);
        loading.join();
        missing += has(*ranges, second) ? 0 : 1;
    }
    CHECK(missing == 0);
}

TEST_CASE(
    "another ETag, size or URL has separate entries, and objects without a version have none") {
    const TemporaryFolder folder;
    const DiskCache cache(folder.path(), kPlenty);
    std::vector<ObjectState> states{
        object_state("\"1\""), object_state("\"2\""), object_state("last-modified: Thu"),
        object_state("\"1\""), object_state("\"1\""), object_state("\"1\"")};
    states[3].size += 1;
    states[4].url += "x";
    states[5].query = "0123";
    for (unsigned i = 0; i < states.size(); ++i) {
        keep(*cache.of(states[i]), {100, 2 * kBlock}, i);
    }
    for (unsigned i = 0; i < states.size(); ++i) {
        CAPTURE(i);
        CHECK(has(*cache.of(states[i]), {100, 2 * kBlock}, i));
    }
    CHECK(cache.of(object_state("")) == nullptr);
    CHECK_FALSE(has(*cache.of(object_state("\"3\"")), {100, 1}));
}

TEST_CASE("files are only accessible to their owner, and their names reveal nothing") {
    const TemporaryFolder folder;
    const auto path = folder / "cache";
    const DiskCache cache(path, kPlenty);
    keep(*cache.of(object_state()), {0, 5 * kBlock});
    CHECK(entries_below(path).size() == 5);
    for (const auto& file : files_below(path)) {
        const std::string name = file.lexically_relative(path).string();
        CAPTURE(name);
        CHECK(name.find("host") == std::string::npos);
        CHECK(name.find("bucky") == std::string::npos);
        CHECK(name.find("abc\"") == std::string::npos);
        struct stat status {};
        REQUIRE(::stat(file.c_str(), &status) == 0);
        CHECK((status.st_mode & 0777U) == 0600U);
    }
}

TEST_CASE("a damaged, truncated or empty entry is not used, and is removed") {
    const TemporaryFolder folder;
    const DiskCache cache(folder.path(), kPlenty);
    const auto ranges = cache.of(object_state());
    const std::vector<std::function<void(std::string&)>> damages{
        [](std::string& s) { s[s.size() / 2] = static_cast<char>(s[s.size() / 2] ^ 1); },
        [](std::string& s) { s.pop_back(); },
        [](std::string& s) { s.clear(); },
        [](std::string& s) { s.assign(s.size(), '\0'); },
        [](std::string& s) { s += "x"; },
        [](std::string& s) { s.resize(10 * kBlock); },
    };
    for (std::size_t i = 0; i < damages.size(); ++i) {
        CAPTURE(i);
        keep(*ranges, {50, 5000});
        const auto files = entries_below(folder.path());
        REQUIRE(files.size() == 1);
        std::string text = read_file(files[0]);
        damages[i](text);
        std::ofstream(files[0], std::ios::binary) << text;
        CHECK_FALSE(has(*ranges, {60, 10}));
        CHECK(entries_below(folder.path()).empty());
    }
    CHECK(cache.warning().empty());
}

TEST_CASE("the least recently used entries are evicted") {
    const TemporaryFolder folder;
    constexpr std::uint64_t kEntry = kBlock + 4096;
    const DiskCache cache(folder.path(), 10 * kEntry);
    const auto ranges = cache.of(object_state());
    for (std::uint64_t i = 0; i < 10; ++i) {
        keep(*ranges, {i * kBlock, kBlock});
    }
    REQUIRE(entries_below(folder.path()).size() == 10);
    for (const auto& file : entries_below(folder.path())) {
        make_older(file, std::chrono::seconds(1000));
    }
    for (const std::uint64_t used : {2, 3, 5}) {
        REQUIRE(has(*ranges, {used * kBlock, 1}));
    }
    for (std::uint64_t i = 10; i < 16; ++i) {
        keep(*ranges, {i * kBlock, kBlock});
        CHECK(bytes_of_entries(folder.path()) <= 10 * kEntry);
    }
    for (const std::uint64_t used : {2, 3, 5, 10, 11, 12, 13, 14, 15}) {
        CAPTURE(used);
        CHECK(has(*ranges, {used * kBlock, kBlock}));
    }
    CHECK(cache.warning().empty());
}

TEST_CASE(
    "with a limit too small for anything nothing is kept, and a smaller limit than before holds") {
    const TemporaryFolder folder;
    {
        const DiskCache cache(folder.path(), 1000);
        keep(*cache.of(object_state()), {0, 10});
        CHECK(entries_below(folder.path()).empty());
        CHECK(cache.warning().empty());
    }
    keep(*DiskCache(folder.path(), kPlenty).of(object_state()), {0, kObjectBytes});
    CHECK(bytes_of_entries(folder.path()) > kObjectBytes);
    const DiskCache cache(folder.path(), 5 * kBlock);
    keep(*cache.of(object_state("2")), {0, 10});
    CHECK(bytes_of_entries(folder.path()) <= 5 * kBlock);
    CHECK(has(*cache.of(object_state("2")), {0, 10}));
}

TEST_CASE("a count that is damaged, missing or far too high is corrected") {
    const TemporaryFolder folder;
    const auto count = folder / "isonest-cache-1" / "bytes";
    const DiskCache cache(folder.path(), 20 * kBlock);
    const auto ranges = cache.of(object_state());
    const std::uint64_t high[2]{19 * kBlock, ~(19 * kBlock)};
    const std::vector<std::string> contents{
        "", "short", std::string(16, 'x'),
        std::string(reinterpret_cast<const char*>(high), sizeof(high))};
    std::uint64_t at = 0;
    for (const std::string& text : contents) {
        std::ofstream(count, std::ios::binary | std::ios::trunc) << text;
        for (int i = 0; i < 2; ++i) {
            keep(*ranges, {at * kBlock, kBlock});
            CHECK(has(*ranges, {at * kBlock, kBlock}));
            ++at;
        }
    }
    std::filesystem::remove(count);
    keep(*ranges, {at * kBlock, kBlock});
    CHECK(has(*ranges, {0, (at + 1) * kBlock}));
    for (; at < 40; ++at) {
        keep(*ranges, {at * kBlock, kBlock});
        REQUIRE(bytes_of_entries(folder.path()) <= 20 * kBlock);
    }
    CHECK(cache.warning().empty());
}

TEST_CASE("four processes together stay within the limit, and get the right bytes") {
    const TemporaryFolder folder;
    constexpr std::uint64_t kMax = 16 * kBlock;
    std::vector<pid_t> children;
    for (unsigned i = 0; i < 4; ++i) {
        children.push_back(start_process([&] {
            return use_cache(folder.path(), kMax, i, in(std::chrono::milliseconds(1500)));
        }));
    }
    std::uint64_t most = 0;
    const auto until = in(std::chrono::milliseconds(1500));
    while (std::chrono::steady_clock::now() < until) {
        most = std::max(most, bytes_of_entries(folder.path()));
    }
    for (const pid_t child : children) {
        CHECK(wait_for(child) == 0);
    }
    CHECK(most > kMax / 2);
    // Measuring takes time: a few entries that are evicted meanwhile are counted in addition to
    // those that replace them.
    CHECK(most <= kMax + kMax / 4);
    CHECK(bytes_of_entries(folder.path()) <= kMax);
    CHECK(entries_below(folder.path()).size() > 4);
}

TEST_CASE("processes that are killed leave a working cache") {
    const TemporaryFolder folder;
    constexpr std::uint64_t kMax = 16 * kBlock;
    std::mt19937_64 random(3);
    for (unsigned round = 0; round < 40; ++round) {
        const pid_t child = start_process(
            [&] { return use_cache(folder.path(), kMax, round, in(std::chrono::seconds(60))); });
        std::this_thread::sleep_for(std::chrono::microseconds(random() % 20'000));
        REQUIRE(::kill(child, SIGKILL) == 0);
        CHECK(WIFSIGNALED(wait_for(child)));
        CHECK(bytes_of_entries(folder.path()) <= kMax);
    }
    CHECK(use_cache(folder.path(), kMax, 100, in(std::chrono::milliseconds(200))));
    // Old files with temporary names are removed.
    std::ofstream(folder / "isonest-cache-1" / "new" / "1-2-3") << "left";
    const auto left = files_below(folder / "isonest-cache-1" / "new");
    REQUIRE_FALSE(left.empty());
    for (const auto& file : left) {
        make_older(file, std::chrono::seconds(100));
    }
    const DiskCache cache(folder.path(), kMax);
    CHECK(files_below(folder / "isonest-cache-1" / "new").empty());
    keep(*cache.of(object_state()), {0, kBlock});
    CHECK(has(*cache.of(object_state()), {0, kBlock}));
    CHECK(bytes_of_entries(folder.path()) <= kMax);
}

TEST_CASE("a process that is stopped while it holds the locks does not stop others") {
    const TemporaryFolder folder;
    const DiskCache cache(folder.path(), 4 * kBlock);
    const auto ranges = cache.of(object_state());
    keep(*ranges, {0, kBlock});
    const auto below = folder / "isonest-cache-1";
    const std::string count = (below / "bytes").string();
    const std::string removing = (below / "removing").string();
    const pid_t child = start_process([&] {
        const int a = ::open(count.c_str(), O_RDWR);
        const int b = ::open(removing.c_str(), O_RDWR | O_CREAT, 0600);
        const bool good = ::flock(a, LOCK_EX) == 0 && ::flock(b, LOCK_EX) == 0;
        std::ofstream(folder / "ready") << "x";
        ::pause();
        return good;
    });
    while (!std::filesystem::exists(folder / "ready")) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const auto start = std::chrono::steady_clock::now();
    for (std::uint64_t i = 1; i < 10; ++i) {
        keep(*ranges, {i * kBlock, kBlock});
    }
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(20));
    CHECK(has(*ranges, {0, kBlock}));
    CHECK_FALSE(has(*ranges, {kBlock, 1}));
    CHECK(cache.warning().empty());
    REQUIRE(::kill(child, SIGKILL) == 0);
    wait_for(child);
    keep(*ranges, {kBlock, kBlock});
    CHECK(has(*ranges, {0, 2 * kBlock}));
}

#ifndef SANITIZED
TEST_CASE("an entry that cannot be loaded for lack of memory is still there afterwards") {
    const TemporaryFolder folder;
    const ByteRange range{kBlock / 2, 5 * kBlock};
    keep(*DiskCache(folder.path(), kPlenty).of(object_state()), range);
    const std::size_t entries = entries_below(folder.path()).size();
    const int status = wait_for(start_process([&] {
        const DiskCache cache(folder.path(), kPlenty);
        const auto ranges = cache.of(object_state());
        std::vector<std::unique_ptr<std::byte[]>> taken;
        taken.reserve(100'000);
        std::uint64_t pages = 0;
        std::ifstream statm("/proc/self/statm");
        for (int i = 0; i < 6; ++i) {  // the sixth number is the size of data
            statm >> pages;
        }
        rlimit before{};
        ::getrlimit(RLIMIT_DATA, &before);
        const auto limit_to = [&](std::uint64_t more) {
            const rlimit limit{pages * static_cast<rlim_t>(::getpagesize()) + more,
                               before.rlim_max};
            ::setrlimit(RLIMIT_DATA, &limit);
        };
        // Memory freed by earlier tests is used up.
        limit_to(0);
        for (const std::size_t size : {kBlock * 16, kBlock, kBlock / 16}) {
            while (taken.size() < taken.capacity()) {
                taken.emplace_back(new (std::nothrow) std::byte[size]);
                if (taken.back() == nullptr) {
                    break;
                }
            }
        }
        int failed = 0;
        int loaded = 0;
        for (std::uint64_t more = 0; more < 40 * kBlock; more += kBlock / 2) {
            limit_to(more);
            bool is_wrong = false;
            try {
                const auto found = ranges->load(range);
                ::setrlimit(RLIMIT_DATA, &before);
                is_wrong = !found || *found != object_bytes(range);
                ++loaded;
            } catch (const std::bad_alloc&) {
                ::setrlimit(RLIMIT_DATA, &before);
                ++failed;
            }
            if (is_wrong) {
                return false;
            }
        }
        return failed > 0 && loaded > 0 && has(*ranges, range) && cache.warning().empty();
    }));
    CHECK(status == 0);
    CHECK(entries_below(folder.path()).size() == entries);
}
#endif

TEST_CASE("a folder that cannot be made is an error, and one that cannot be used gives a warning") {
    const TemporaryFolder folder;
    std::ofstream(folder / "file") << "x";
    for (const auto& path : {folder / "file", folder / "file" / "below"}) {
        try {
            const DiskCache cache(path, kPlenty);
            FAIL("was made");
        } catch (const Error& error) {
            CHECK(error.kind() == ErrorKind::invalid_argument);
            CHECK(error.place().file == path.string());
        }
    }
    const auto is_off = [](const DiskCache& cache) {
        const auto ranges = cache.of(object_state());
        keep(*ranges, {0, 10});
        keep(*ranges, {kBlock, kBlock});
        return !has(*ranges, {0, 10}) && !cache.warning().empty() &&
               cache.warning().find('\n') == std::string::npos;
    };
    // Something else has this name.
    const auto taken = folder / "taken";
    std::filesystem::create_directories(taken);
    std::ofstream(taken / "isonest-cache-1") << "x";
    const DiskCache in_the_way(taken, kPlenty);
    CHECK(is_off(in_the_way));
    // Others can write into it.
    const auto open_to_all = folder / "open";
    keep(*DiskCache(open_to_all, kPlenty).of(object_state()), {0, 10});
    CHECK(::chmod((open_to_all / "isonest-cache-1").c_str(), 0722) == 0);
    CHECK(is_off(DiskCache(open_to_all, kPlenty)));
    // It is removed meanwhile.
    const auto gone = folder / "gone";
    const DiskCache vanished(gone, kPlenty);
    std::filesystem::remove_all(gone);
    CHECK(is_off(vanished));
    // No file can grow, as on a full disk; what was kept is still there.
    const auto full = folder / "full";
    const int status = wait_for(start_process([&] {
        const DiskCache cache(full, kPlenty);
        const auto ranges = cache.of(object_state());
        keep(*ranges, {kBlock, 10});
        ::signal(SIGXFSZ, SIG_IGN);
        const struct rlimit limit { 1000, 1000 };
        ::setrlimit(RLIMIT_FSIZE, &limit);
        keep(*ranges, {0, 5000});
        return !ranges->load({0, 10}) && ranges->load({kBlock, 10}) &&
               cache.warning().find("nothing more is kept") != std::string::npos &&
               files_below(full / "isonest-cache-1" / "new").empty();
    }));
    CHECK(status == 0);
    // Only the owner can write, and this process runs as another user, if possible.
    const auto foreign = folder / "foreign";
    keep(*DiskCache(foreign, kPlenty).of(object_state()), {0, 10});
    const int foreign_status = wait_for(start_process([&] {
        if (::geteuid() == 0) {
            if (::chmod(folder.path().c_str(), 0755) != 0 || ::setuid(65534) != 0) {
                return false;
            }
            return is_off(DiskCache(foreign, kPlenty));
        }
        ::chmod((foreign / "isonest-cache-1").c_str(), 0500);
        const DiskCache cache(foreign, kPlenty);
        const auto ranges = cache.of(object_state("other"));
        keep(*ranges, {0, 10});
        return !ranges->load({0, 10}) && !cache.warning().empty();
    }));
    ::chmod((foreign / "isonest-cache-1").c_str(), 0700);
    CHECK(foreign_status == 0);
}
