// Sequences that are sorted by blocks, and whose space is released while they are read.
#include <catch2/catch.hpp>
#include <cstdint>
#include <random>
#include <vector>

#include "query/simplify/block_files.h"
#include "store/files/scratch_file.h"
#include "tests/support/test_support.h"

using namespace isonest::detail;
using namespace isonest::detail::test;

TEST_CASE("Items of a block are returned in the order in which they were appended") {
    const TemporaryFolder folder;
    std::mt19937 random(5);
    const std::size_t count = GENERATE(0, 1, 50000);
    for (const std::uint32_t blocks : {1U, 7U, 300U}) {
        std::vector<std::vector<std::uint64_t>> expected(blocks);
        std::vector<std::uint32_t> block_of;
        const bool at_once = blocks == 7;
        BlockItems<std::uint64_t> items(folder.path());
        std::uint32_t block = 0;
        for (std::uint64_t i = 0; i < count; ++i) {
            if (random() % 5 == 0) {  // runs of varying length
                block = static_cast<std::uint32_t>(random() % blocks);
            }
            block_of.push_back(block);
            expected[block].push_back(i * i);
            if (at_once) {
                items.append(i * i, block);
            } else {
                items.append(i * i);
            }
        }
        items.seal();
        for (std::size_t i = 0; i < count && !at_once; ++i) {
            items.add_block(block_of[i]);
        }
        items.sort(blocks);
        REQUIRE(items.count() == count);
        for (std::uint32_t b = 0; b < blocks; ++b) {
            std::vector<std::uint64_t> found;
            items.each(b, [&](std::uint64_t item) { found.push_back(item); });
            REQUIRE(found == expected[b]);
            REQUIRE(items.count_in(b) == found.size());
        }
    }
}

TEST_CASE("Consumed blocks take no space, and the others are unchanged") {
    const TemporaryFolder folder;
    const auto scratch = ScratchFolder::metered(folder.path());
    constexpr std::uint32_t kBlocks = 10;
    constexpr std::uint64_t kItems = 200000;
    BlockItems<std::uint64_t> items(scratch);
    for (std::uint64_t i = 0; i < kItems; ++i) {
        items.append(i, static_cast<std::uint32_t>(i * kBlocks / kItems + i % 2) % kBlocks);
    }
    items.seal();
    items.sort(kBlocks);
    for (std::uint32_t b = 0; b < kBlocks; ++b) {
        std::uint64_t sum = 0;
        std::uint64_t expected = 0;
        for (std::uint64_t i = 0; i < kItems; ++i) {
            expected += (i * kBlocks / kItems + i % 2) % kBlocks == b ? i : 0;
        }
        items.each(b, [&](std::uint64_t item) { sum += item; });
        REQUIRE(sum == expected);
        items.consume(b);
    }
    // All space except that for the sorting is released: the same amount can be allocated again.
    const std::uint64_t peak = scratch.meter()->peak();
    ScratchFile other(scratch);
    other.map(kItems * sizeof(std::uint64_t));
    REQUIRE(scratch.meter()->peak() == peak);
}

TEST_CASE("A packed triangle has the original corners") {
    std::mt19937_64 random(3);
    for (int i = 0; i < 1000; ++i) {
        const std::uint64_t most = (std::uint64_t{1} << (1 + random() % 48)) - 1;
        const ElementCorners corners{random() & most, random() & most, most};
        Displacement by;
        by.radius = 3;
        const PackedTriangle packed(corners, 2, by);
        REQUIRE(packed.corners() == corners);
        REQUIRE(packed.mark == 2);
        REQUIRE(packed.displacement == by);
    }
}
