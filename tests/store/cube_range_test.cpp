// The ranges of cubes agree with a direct search over the values, and what they exclude contains no
// surface.
#include <catch2/catch.hpp>
#include <fstream>
#include <mutex>

#include <isonest/error.h>

#include "query/check/check.h"
#include "query/traverse/traversal.h"
#include "store/container/wrapped_sources.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

template <class T>
void require_ranges(FunctionVolume<T>& volume, int chunk) {
    const Int3 n = volume.nodes();
    CAPTURE(n.x, n.y, n.z, chunk, name_of(value_type_of<T>));
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(chunk));
    const StoreReader store(folder / "s");
    const Lattice& lattice = store.layout().lattice();
    int levels = 0;
    for (int level = 0; level <= lattice.top(); ++level) {
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 cells = lattice.cells_at(level);
        if (level < kFirstRangeLevel || cells.product() == 0) {
            CHECK(!store.cube_range(level, {0, 0, 0}));
            continue;
        }
        ++levels;
        for (std::int64_t c = 0; c < cells.product(); ++c) {
            const Int3 cube = cells.unlinear(c);
            double low = std::numeric_limits<double>::infinity();
            double high = -low;
            const Int3 end = min((cube + Int3{1, 1, 1}) * edge, n - Int3{1, 1, 1});
            const Int3 count = end - cube * edge + Int3{1, 1, 1};
            for (std::int64_t i = 0; i < count.product(); ++i) {
                const auto v = static_cast<double>(volume.at(cube * edge + count.unlinear(i)));
                low = std::fmin(low, v);
                high = std::fmax(high, v);
            }
            const CubeRange range = *store.cube_range(level, cube);
            // Within the precision of binary32.
            const auto near = [](double stored, double exact) {
                return stored == exact || std::fabs(stored - exact) <= std::fabs(exact) * 0x1p-23 ||
                       std::fabs(exact) > std::numeric_limits<float>::max();
            };
            REQUIRE(range.low <= low);
            REQUIRE(range.high >= high);
            REQUIRE(near(range.low, low));
            REQUIRE(near(range.high, high));
        }
        CHECK(!store.cube_range(level, cells));
        CHECK(!store.cube_range(level, {-1, 0, 0}));
    }
    CHECK((levels > 0) == (lattice.top() >= kFirstRangeLevel && lattice.dimension() == 3));
    CHECK(check(store, {}, silent_progress()).failures == 0);
}

/// The store without ranges, as in older versions.
class WithoutRanges : public RecordingSource {
  public:
    using RecordingSource::RecordingSource;
    [[nodiscard]] std::optional<CubeRange> cube_range(int /*level*/,
                                                      const Int3& /*cube*/) const override {
        return std::nullopt;
    }
};

using Triangle = std::array<Double3, 3>;

struct Found {
    std::vector<Triangle> triangles;
    TraversalCounts counts;
};

Found found(const ChunkSource& source, double iso, double error) {
    ChunkCache cache(source, 1U << 24U);
    TraversalQuery query;
    query.iso = iso;
    query.tolerance = Tolerance(error, {}, {}, {}, {});
    const Int3 last = source.layout().lattice().nodes() - Int3{1, 1, 1};
    query.box.hi = {static_cast<double>(last.x), static_cast<double>(last.y),
                    static_cast<double>(last.z)};
    Found out;
    std::mutex mutex;
    out.counts = traverse(
        cache, query, 4096,
        [&](std::uint64_t, const MeshPart& part) {
            const std::lock_guard lock(mutex);
            for (const auto& t : part.triangles) {
                out.triangles.push_back(
                    {part.positions[t[0]], part.positions[t[1]], part.positions[t[2]]});
            }
        },
        silent_progress());
    std::sort(out.triangles.begin(), out.triangles.end());
    return out;
}

/// Noise with a few peaks: a bound on the distance from the linear function excludes little of it.
std::uint16_t peaks(const Int3& p) {
    const bool peak = p.x % 37 == 11 && p.y % 41 == 30 && p.z == 20;
    return static_cast<std::uint16_t>(1000 * noise(p) + (peak ? 3000 : 0));
}

}  // namespace

TEST_CASE("a cube's range is that of its values, for every size and type") {
    for (const Int3& n : {Int3{9, 9, 9}, Int3{10, 3, 2}, Int3{8, 9, 8}, Int3{33, 17, 65},
                          Int3{50, 21, 38}, Int3{2, 2, 70}, Int3{40, 30, 1}, Int3{1, 1, 50}}) {
        FunctionVolume<std::uint8_t> bytes(
            n, [](const Int3& p) { return static_cast<std::uint8_t>(255 * noise(p)); });
        require_ranges(bytes, 8);
        require_ranges(bytes, 16);
        for (const double size : {1.0, 1e200}) {
            FunctionVolume<double> reals(n, [&](const Int3& p) { return size * (noise(p) - 0.5); });
            require_ranges(reals, 8);
        }
    }
    const Int3 n{34, 20, 19};
    FunctionVolume<std::int32_t> wide(
        n, [](const Int3& p) { return static_cast<std::int32_t>(4e9 * (noise(p) - 0.5)); });
    require_ranges(wide, 16);
    FunctionVolume<std::int16_t> shorts(
        n, [](const Int3& p) { return static_cast<std::int16_t>(65535 * (noise(p) - 0.5)); });
    require_ranges(shorts, 64);
    FunctionVolume<float> holes(n, [](const Int3& p) {
        return p.x < 18           ? std::numeric_limits<float>::quiet_NaN()
               : noise(p) < 0.001 ? std::numeric_limits<float>::infinity()
                                  : static_cast<float>(noise(p));
    });
    require_ranges(holes, 8);
}

TEST_CASE("what the ranges exclude has no surface, and they exclude much if peaks are rare") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint16_t> volume({97, 90, 70}, peaks);
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    const WithoutRanges plain(store);
    for (const double error : {0.0, 10.0, 300.0}) {
        for (const double iso : {500.0, 999.0, 1200.0, 2500.0}) {
            CAPTURE(error, iso);
            const Found with = found(store, iso, error);
            const Found without = found(plain, iso, error);
            CHECK(!with.triangles.empty());
            CHECK(with.triangles == without.triangles);
            CHECK(with.counts.visited <= without.counts.visited);
            if (error > 0 && iso == 1200.0) {
                CHECK(with.counts.visited * 20 < without.counts.visited);
            }
            if (error > 0 && iso > 1000.0) {
                CHECK(with.counts.visited < with.counts.leaves * 4);
            }
        }
    }
}

TEST_CASE("a damaged range is reported, and other ranges can still be used") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint16_t> volume({97, 90, 70}, peaks);
    make_store(volume, folder / "s", with_chunk(16));
    std::string bytes = read_file(folder / "s");
    std::string wanted;
    {
        const StoreReader store(folder / "s");
        for (std::int64_t x = 2; x < 12; ++x) {
            const CubeRange range = *store.cube_range(3, {x, 5, 3});
            for (const float number : {range.low, range.high}) {
                const auto value = static_cast<std::uint16_t>(number);
                wanted.append(reinterpret_cast<const char*>(&value), sizeof(value));
            }
        }
    }
    const std::size_t at = bytes.find(wanted);
    REQUIRE(at != std::string::npos);
    REQUIRE(bytes.find(wanted, at + 1) == std::string::npos);
    bytes[at] = static_cast<char>(bytes[at] ^ 1);
    std::ofstream(folder / "damaged", std::ios::binary) << bytes;

    const StoreReader store(folder / "damaged");
    const auto is_corrupt = Catch::Matchers::Predicate<Error>(
        [](const Error& e) { return e.kind() == ErrorKind::corrupt; }, "corrupt");
    CHECK_THROWS_MATCHES(store.cube_range(3, {0, 0, 3}), Error, is_corrupt);
    CHECK(store.cube_range(3, {0, 0, 2}));
    CHECK(store.cube_range(4, {0, 0, 0}));
    Extraction options;
    options.iso = 2500;
    options.error = 10;
    CHECK_THROWS_MATCHES(extract(store, folder / "m.ply", options, silent_progress()), Error,
                         is_corrupt);
    CHECK(!std::filesystem::exists(folder / "m.ply"));
    options.error = 0;  // does not need ranges
    extract(store, folder / "m.ply", options, silent_progress());
    for (const CheckDepth depth : {CheckDepth::quick, CheckDepth::standard}) {
        CheckOptions how;
        how.depth = depth;
        const CheckReport report = check(store, how, silent_progress());
        REQUIRE(report.failures == 1);
        CHECK(report.findings[0].test == "cube range");
        CHECK(report.findings[0].level == 3);
        CHECK(report.findings[0].node == Int3{0, 0, 24});
    }
}
