// The reported angles, area and volume, compared with a sorted list of all angles of the mesh and
// sums over its triangles.
#include "query/mesh/measuring_sink.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>

#include <isonest/extract.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Point = std::array<float, 3>;

/// The three angles, by the law of cosines.
double angle_of(const Point& a, const Point& b, const Point& c) {
    const auto size = [](const Point& p, const Point& q) {
        return std::hypot(static_cast<long double>(p[0]) - q[0],
                          static_cast<long double>(p[1]) - q[1],
                          static_cast<long double>(p[2]) - q[2]);
    };
    const std::array<long double, 3> s{size(b, c), size(c, a), size(a, b)};
    long double least = 180;
    for (std::size_t i = 0; i < 3; ++i) {
        const long double u = s[(i + 1) % 3];
        const long double v = s[(i + 2) % 3];
        if (u == 0 || v == 0) {
            return 0;
        }
        const long double cosine = (u * u + v * v - s[i] * s[i]) / (2 * u * v);
        least = std::min(least, std::acos(std::clamp(cosine, -1.0L, 1.0L)) * 180 / M_PIl);
    }
    return static_cast<double>(least);
}

void require_sorted(const TriangleQuality& q, const MeshCollector& mesh) {
    std::vector<double> angles;
    for (const auto& t : mesh.triangles) {
        angles.push_back(angle_of(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
    }
    std::sort(angles.begin(), angles.end());
    const auto quantile = [&](double share) {
        return angles[static_cast<std::size_t>(share * static_cast<double>(angles.size()))];
    };
    constexpr double kUnsure = 1e-6;
    CHECK(q.least == Approx(angles.front()).margin(kUnsure));
    for (const auto& [stated, share] : {std::pair{q.per_mille, 0.001},
                                        {q.percent, 0.01},
                                        {q.five_percent, 0.05},
                                        {q.median, 0.5}}) {
        CAPTURE(share);
        CHECK(stated <= quantile(share) + kUnsure);
        CHECK(stated >= quantile(share) - 0.01 - kUnsure);
    }
    const auto narrow = std::count_if(angles.begin(), angles.end(), [](double a) { return a < 5; });
    CHECK(q.narrow_share ==
          Approx(static_cast<double>(narrow) / static_cast<double>(angles.size())).margin(1e-4));
}

/// Of all triangles, in long double; the volume is signed, relative to the first vertex.
std::array<long double, 2> area_and_volume(const MeshCollector& mesh) {
    std::array<long double, 2> sums{};
    for (const auto& t : mesh.triangles) {
        std::array<std::array<long double, 3>, 3> p{};
        for (std::size_t c = 0; c < 3; ++c) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                p[c][axis] =
                    static_cast<long double>(mesh.vertices[t[c]][axis]) - mesh.vertices[0][axis];
            }
        }
        std::array<long double, 3> n{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::size_t y = (axis + 1) % 3;
            const std::size_t z = (axis + 2) % 3;
            n[axis] = (p[1][y] - p[0][y]) * (p[2][z] - p[0][z]) -
                      (p[1][z] - p[0][z]) * (p[2][y] - p[0][y]);
            sums[1] += p[0][axis] * n[axis] / 6;
        }
        sums[0] += std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2;
    }
    return sums;
}

/// Whether each edge has a triangle on both sides.
bool is_closed(const MeshCollector& mesh) {
    std::map<std::array<std::uint32_t, 2>, int> passed;
    for (const auto& t : mesh.triangles) {
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t a = t[i];
            const std::uint32_t b = t[(i + 1) % 3];
            passed[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
        }
    }
    return std::all_of(passed.begin(), passed.end(), [](const auto& p) { return p.second == 0; });
}

/// Requests batches in order, in two passes.
class TwiceInOrder : public MeshCollector {
  public:
    [[nodiscard]] bool concurrent() const override { return false; }
    [[nodiscard]] bool again() override { return std::exchange(again_, false); }

  private:
    bool again_ = true;
};

}  // namespace

TEST_CASE("smallest angles agree with the law of cosines, down to triangles without area") {
    CHECK(smallest_angle({0, 0, 0}, {1, 0, 0}, {0, 1, 0}) == Approx(45));
    CHECK(smallest_angle({1, 0, 0}, {0, 1, 0}, {0, 0, 1}) == Approx(60));
    CHECK(smallest_angle({0, 0, 0}, {1, 0, 0}, {1, 1e-4F, 0}) == Approx(0.00572957786));
    CHECK(smallest_angle({0, 0, 0}, {0, 0, 0}, {1, 1, 0}) == 0);
    CHECK(smallest_angle({2, 2, 2}, {2, 2, 2}, {2, 2, 2}) == 0);
    CHECK(smallest_angle({0, 0, 0}, {1, 1, 1}, {3, 3, 3}) == 0);
    for (int i = 0; i < 1000; ++i) {
        std::array<Point, 3> p{};
        for (int k = 0; k < 9; ++k) {
            p[static_cast<std::size_t>(k / 3)][static_cast<std::size_t>(k % 3)] =
                static_cast<float>(noise({i, k, 0}));
        }
        CHECK(smallest_angle(p[0], p[1], p[2]) == Approx(angle_of(p[0], p[1], p[2])).margin(1e-6));
    }
}

TEST_CASE("the reported angles are those of the mesh, for any threads and any sink") {
    FunctionVolume<float> volume(
        {45, 38, 41}, [](const Int3& p) { return static_cast<float>(smooth(p) + 0.1 * noise(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    SurfaceQuery query;
    query.iso = 0.3;
    ExtractOptions options;
    options.scratch = folder.path();
    MeshCollector unmeasured;
    CHECK(!extract(store, query, unmeasured, options).quality);
    options.quality = true;
    for (const bool simplified : {false, true}) {
        if (simplified) {
            query.stop = DistanceBound{0.3, true};
        }
        std::optional<TriangleQuality> first;
        for (const int threads : {1, 2, 4}) {
            options.threads = threads;
            MeshCollector mesh;
            const ExtractReport r = extract(store, query, mesh, options);
            REQUIRE(r.quality);
            CHECK((simplified || mesh.vertices == unmeasured.vertices));
            require_sorted(*r.quality, mesh);
            first = first.value_or(*r.quality);
            CHECK(r.quality->least == first->least);
            CHECK(r.quality->median == first->median);
            CHECK(r.quality->narrow_share == first->narrow_share);
        }
        TwiceInOrder twice;
        const ExtractReport r = extract(store, query, twice, options);
        require_sorted(r.quality.value(), twice);
        CHECK(r.quality->narrow_share == first->narrow_share);
    }
    query.iso = 1e9;
    MeshCollector empty;
    const ExtractReport r = extract(store, query, empty, options);
    REQUIRE(r.quality);
    CHECK(r.quality->median == 0);
}

TEST_CASE(
    "the reported area and volume are those of the mesh, for any threads, memory and sink; an open "
    "mesh has no volume") {
    FunctionVolume<float> volume(
        {45, 38, 41}, [](const Int3& p) { return static_cast<float>(smooth(p) + 0.1 * noise(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    ExtractOptions options;
    options.scratch = folder.path();
    SurfaceQuery query;
    query.iso = 0.3;
    for (const bool closed : {false, true}) {
        query.stages.close = closed ? std::optional(Outside::below) : std::nullopt;
        for (const double distance : {0.0, 0.4}) {
            query.stop = ErrorBound{};
            if (distance > 0) {
                query.stop = DistanceBound{distance, true};
            }
            std::optional<SurfaceMeasures> first;
            for (const int threads : {1, 2, 7}) {
                CAPTURE(closed, distance, threads);
                options.threads = threads;
                options.memory = std::uint64_t{threads == 7 ? 512U : 128U} << 20U;
                MeshCollector mesh;
                TwiceInOrder twice;
                MeshSink& sink = threads == 2 ? twice : mesh;
                const SurfaceMeasures m = extract(store, query, sink, options).measures.value();
                const MeshCollector& made = threads == 2 ? twice : mesh;
                const auto [area, within] = area_and_volume(made);
                CHECK(m.area == Approx(static_cast<double>(area)).epsilon(1e-12));
                CHECK(is_closed(made) == closed);
                REQUIRE(m.volume.has_value() == closed);
                if (closed) {
                    CHECK(*m.volume ==
                          Approx(static_cast<double>(std::fabs(within))).epsilon(1e-11));
                }
                first = first.value_or(m);
                CHECK(m.area == first->area);
                CHECK(m.volume == first->volume);
            }
        }
    }
    query.iso = 1e9;
    MeshCollector empty;
    const SurfaceMeasures m = extract(store, query, empty, options).measures.value();
    CHECK(m.area == 0);
    CHECK(m.volume == 0.0);
}

TEST_CASE("a ball's area and volume; a void has a negative volume") {
    const auto radius = [](const Int3& p) {
        return static_cast<float>(std::hypot(p.x - 20, p.y - 20, p.z - 20));
    };
    FunctionVolume<float> ball({41, 41, 41}, radius);
    FunctionVolume<float> shell({41, 41, 41},
                                [&](const Int3& p) { return std::fabs(radius(p) - 12); });
    const TemporaryFolder folder;
    make_store(ball, folder / "ball", with_chunk(16));
    make_store(shell, folder / "shell", with_chunk(16));
    SurfaceQuery query;
    query.iso = 15.3;
    MeshCollector mesh;
    const SurfaceMeasures b = extract(Store(folder / "ball"), query, mesh, {}).measures.value();
    CHECK(b.area == Approx(4 * M_PI * 15.3 * 15.3).epsilon(0.01));
    CHECK(b.volume.value() == Approx(4 * M_PI / 3 * std::pow(15.3, 3)).epsilon(0.01));
    query.iso = 3.3;
    const SurfaceMeasures s = extract(Store(folder / "shell"), query, mesh, {}).measures.value();
    CHECK(s.volume.value() ==
          Approx(4 * M_PI / 3 * (std::pow(15.3, 3) - std::pow(8.7, 3))).epsilon(0.01));
}
