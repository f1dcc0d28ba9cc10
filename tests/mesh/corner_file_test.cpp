// Meshes in temporary files: corners of 32 and 64 bits, and how much space they take.
#include <catch2/catch.hpp>
#include <cstdint>
#include <span>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"
#include "tests/support/test_support.h"

using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kFew = 0xFFFFFFFE;  ///< number of vertices up to which corners take 32 bits

/// `count` triangles, with the last of `vertices` among their corners.
std::vector<ElementCorners> some_corners(std::uint64_t count, std::uint64_t vertices) {
    std::vector<ElementCorners> corners;
    for (std::uint64_t i = 0; i < count; ++i) {
        const std::uint64_t v = i * 0x9E3779B97F4A7C15ULL;
        corners.push_back({v % vertices, vertices - 1 - i % vertices, i % vertices});
    }
    return corners;
}

}  // namespace

TEST_CASE("Corners are read back unchanged, in 32 or 64 bits") {
    const TemporaryFolder folder;
    const auto [vertices, bits, each] = GENERATE(table<std::uint64_t, CornerFile::Bits, int>({
        {1, CornerFile::Bits::as_needed, 12},
        {kFew, CornerFile::Bits::as_needed, 12},
        {kFew + 1, CornerFile::Bits::as_needed, 24},
        {std::uint64_t{1} << 40U, CornerFile::Bits::as_needed, 24},
        {kFew, CornerFile::Bits::all, 24},
    }));
    const std::vector<ElementCorners> corners = some_corners(5000, vertices);
    const auto scratch = ScratchFolder::metered(folder.path());
    CornerFile file(scratch, bits);
    file.begin(vertices);
    constexpr std::size_t kFirst = 1700;
    file.write(kFirst, std::span(corners).subspan(kFirst));
    file.write(0, std::span(corners).first(kFirst));
    file.map(corners.size());
    REQUIRE(scratch.meter()->peak() == corners.size() * static_cast<std::uint64_t>(each));
    REQUIRE(file.size() == corners.size());
    const CornerView all = file.all();
    REQUIRE(std::vector<ElementCorners>(all.begin(), all.end()) == corners);
    const CornerView some = all.subspan(100, 50);
    REQUIRE(std::vector<ElementCorners>(some.begin(), some.end()) ==
            std::vector<ElementCorners>(corners.begin() + 100, corners.begin() + 150));
    REQUIRE(some[3] == corners[103]);
    if (bits == CornerFile::Bits::all) {
        REQUIRE(file.in_64_bits()[4999] == corners[4999]);
    }

    file.set(7, {CornerFile::kNoVertex, 0, vertices - 1});
    REQUIRE(file.at(7, 0) == CornerFile::kNoVertex);
    REQUIRE(file[7] == ElementCorners{CornerFile::kNoVertex, 0, vertices - 1});
    file.set(7, 0, 0);
    REQUIRE(file.at(7, 0) == 0);
    file.shrink(8);
    REQUIRE(file.all().size() == 8);
    file.clear();
    REQUIRE(file.all().empty());
}

TEST_CASE("A view of a vector gives the elements of the vector") {
    const std::vector<ElementCorners> corners = some_corners(20, 30);
    const CornerView view = corners;
    REQUIRE(std::vector<ElementCorners>(view.begin(), view.end()) == corners);
    REQUIRE(CornerView().empty());
    REQUIRE(CornerView().begin() == CornerView().end());
}

TEST_CASE("The meter reports the peak of the temporary space") {
    const TemporaryFolder folder;
    const auto scratch = ScratchFolder::metered(folder.path());
    const ScratchMeter& meter = *scratch.meter();
    const std::vector<std::byte> bytes(100000);
    {
        ScratchFile first(scratch);
        first.write_at(0, bytes);
        first.write_at(50000, bytes);
        REQUIRE(meter.peak() == 150000);
        first.map(150000);
        first.map(160000);
        REQUIRE(meter.peak() == 160000);
        first.release(8192, 81920);
        ScratchFile second(scratch);
        second.map(81920);
        REQUIRE(meter.peak() == 160000);  // if the file system can punch holes
        ScratchFile moved(std::move(first));
        moved.clear();
        second.map(150000);
        REQUIRE(meter.peak() == 160000);
        moved.write_at(0, bytes);
        REQUIRE(meter.peak() == 250000);
        second = std::move(moved);
        ScratchFile third(scratch);
        third.map(150000);
        REQUIRE(meter.peak() == 250000);
    }
    ScratchFile last(scratch);
    last.map(250000);
    REQUIRE(meter.peak() == 250000);
    ScratchFile not_counted(folder.path());
    not_counted.map(1000000);
    REQUIRE(meter.peak() == 250000);
}
