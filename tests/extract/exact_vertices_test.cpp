// Exact vertices: vertices of coarse surfaces are vertices of the surface at full resolution. The
// meshes have no cracks and are within twice the tolerance.
#include <catch2/catch.hpp>
#include <set>

#include <isonest/error.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

struct Result {
    Mesh mesh;
    std::string bytes;
    ExtractReport report;
};

struct How {
    int chunk = 8;
    int threads = 2;
    std::uint64_t memory = 1U << 30U;
};

template <class T>
Result surface(FunctionVolume<T>& volume, double iso, double error, VertexPlace vertices,
               const std::optional<WorldBox>& box = {}, const How& how = {}) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(how.chunk));
    const StoreReader store(folder / "s");
    Extraction e;
    e.iso = iso;
    e.error = error;
    e.vertices = vertices;
    e.box = box;
    e.threads = how.threads;
    e.memory = how.memory;
    Result r;
    r.report = extract(store, folder / "m.ply", e, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    return r;
}

float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}
float rough(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.3 * noise(p));
}

template <class T>
void require_whole(const FunctionVolume<T>& volume, const Mesh& mesh) {
    const Int3 n = volume.nodes();
    const MeshFaults faults = check_mesh(
        mesh, {0, 0, 0},
        {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1), static_cast<double>(n.z - 1)});
    CHECK(faults.unused_vertices == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.open_edges_inside == 0);
}

/// Where coarse elements reach beyond the volume, their triangles are clipped at its faces.
template <class T, class Point>
bool is_on_face(const FunctionVolume<T>& volume, const Point& p) {
    for (int axis = 0; axis < 3; ++axis) {
        const double x = p[static_cast<std::size_t>(axis)];
        const auto last = static_cast<double>(volume.nodes()[axis] - 1);
        if (last > 0 && (x <= 0 || x >= last)) {
            return true;
        }
    }
    return false;
}

template <class T>
double largest_offset(const FunctionVolume<T>& volume, const Mesh& mesh, double iso) {
    double worst = 0;
    constexpr int kSteps = 4;
    for (const auto& t : mesh.triangles) {
        for (int a = 0; a <= kSteps; ++a) {
            for (int b = 0; a + b <= kSteps; ++b) {
                Double3 p{};
                for (std::size_t i = 0; i < 3; ++i) {
                    p[i] = (a * static_cast<double>(mesh.vertices[t[0]][i]) +
                            b * static_cast<double>(mesh.vertices[t[1]][i]) +
                            (kSteps - a - b) * static_cast<double>(mesh.vertices[t[2]][i])) /
                           kSteps;
                }
                worst = std::max(worst, std::fabs(fine_value(volume, p) - iso));
            }
        }
    }
    return worst;
}

}  // namespace

TEST_CASE("exact vertices are vertices of the full surface, and the mesh has no cracks") {
    for (const Int3& n :
         {Int3{33, 33, 33}, Int3{20, 31, 17}, Int3{2, 2, 2}, Int3{3, 40, 5}, Int3{41, 6, 13}}) {
        for (const auto function : {smooth_f, rough}) {
            FunctionVolume<float> volume(n, function);
            for (const double iso : {-0.4, 0.13}) {
                const Result full = surface(volume, iso, 0, VertexPlace::linear);
                const std::set<std::array<float, 3>> vertices(full.mesh.vertices.begin(),
                                                              full.mesh.vertices.end());
                for (const double error : {0.0, 0.02, 0.2, 1.0}) {
                    CAPTURE(n.x, n.y, n.z, iso, error);
                    const Result r = surface(volume, iso, error, VertexPlace::exact);
                    require_whole(volume, r.mesh);
                    CHECK(r.report.error_bound <= 2 * error);
                    CHECK(largest_offset(volume, r.mesh, iso) <= r.report.error_bound + 2e-5);
                    CHECK((error > 0 || r.bytes == full.bytes));
                    for (const auto& v : r.mesh.vertices) {
                        REQUIRE((is_on_face(volume, v) || vertices.contains(v)));
                    }
                }
            }
        }
    }
}

TEST_CASE("exact vertices in a box leave no crack where the box clips the surface") {
    FunctionVolume<float> volume({30, 28, 26}, rough);
    const WorldBox box{{3.3, 4.1, 2.7}, {21.2, 19.9, 22.5}};
    for (const double error : {0.05, 0.4}) {
        const Result r = surface(volume, 0.1, error, VertexPlace::exact, box);
        const MeshFaults faults = check_mesh(r.mesh, box.lo, box.hi);
        CHECK(faults.overused_edges == 0);
        CHECK(faults.misoriented_edges == 0);
        CHECK(faults.open_edges_inside == 0);
        CHECK(largest_offset(volume, r.mesh, 0.1) <= r.report.error_bound + 2e-5);
    }
}

TEST_CASE("exact vertices with nodes at the isovalue, and beside missing values") {
    FunctionVolume<std::uint8_t> levels(
        {17, 12, 20}, [](const Int3& p) { return static_cast<std::uint8_t>(5 * noise(p)); });
    FunctionVolume<float> holes({21, 20, 19}, [](const Int3& p) {
        return noise(p, 3) < 0.01 ? std::numeric_limits<float>::quiet_NaN() : rough(p);
    });
    for (const double error : {0.0, 1.0, 2.5}) {
        const Result r = surface(levels, 2, error, VertexPlace::exact);
        require_whole(levels, r.mesh);
        CHECK(largest_offset(levels, r.mesh, 2) <= r.report.error_bound + 1e-4);
        const Result h = surface(holes, 0.1, error / 5, VertexPlace::exact);
        CHECK(largest_offset(holes, h.mesh, 0.1) <= h.report.error_bound + 1e-4);
    }
}

TEST_CASE("exact vertices give the same bytes for any threads, chunk and memory") {
    FunctionVolume<float> volume({70, 40, 45}, rough);
    const std::string bytes = surface(volume, 0.1, 0.3, VertexPlace::exact).bytes;
    for (const How& how : {How{64, 1}, How{16, 4}, How{16, 4, 20U << 20U}}) {
        CHECK(surface(volume, 0.1, 0.3, VertexPlace::exact, {}, how).bytes == bytes);
    }
}

TEST_CASE(
    "the distance from a sphere decreases with the square of the element size, as its curvature "
    "predicts") {
    FunctionVolume<float> volume({129, 129, 129}, [](const Int3& p) {
        return static_cast<float>(std::hypot(static_cast<double>(p.x) - 64,
                                             static_cast<double>(p.y) - 64,
                                             static_cast<double>(p.z) - 64));
    });
    constexpr double kRadius = 50;
    const auto furthest = [&](VertexPlace vertices, double error) {
        double worst = 0;
        for (const auto& v : surface(volume, kRadius, error, vertices).mesh.vertices) {
            const double r = std::hypot(v[0] - 64.0, v[1] - 64.0, v[2] - 64.0);
            worst = std::max(worst, std::fabs(r - kRadius));
        }
        return worst;
    };
    // The finest function itself is within 0.02 of the sphere.
    CHECK(furthest(VertexPlace::exact, 2) < 0.02);
    CHECK(furthest(VertexPlace::linear, 2) > 0.2);
}

TEST_CASE("isolines support exact vertices, too") {
    FunctionVolume<float> volume({90, 70, 1}, rough);
    const TemporaryFolder folder;
    make_store(volume, folder / "s");
    const StoreReader store(folder / "s");
    std::set<std::array<double, 3>> full;
    for (const double error : {0.0, 0.4}) {
        Extraction e;
        e.iso = 0.2;
        e.error = error;
        e.vertices = VertexPlace::exact;
        static_cast<void>(extract(store, folder / "l.obj", e, silent_progress()));
        const Lines lines = read_lines(folder / "l.obj");
        REQUIRE(lines.segments.size() > 10);
        for (const Double3& p : lines.points) {
            if (error == 0) {
                full.insert(p);
            }
            REQUIRE((is_on_face(volume, p) || full.contains(p)));
        }
    }
}

TEST_CASE("exact vertices are refused where they are not defined") {
    FunctionVolume<float> volume({9, 9, 9}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s");
    const Store store(folder / "s");
    MeshCollector mesh;
    SurfaceQuery query;
    query.grid.vertices = VertexPlace::exact;
    query.stages.close = Outside::below;
    CHECK_THROWS_AS(isonest::extract(store, query, mesh), Error);
    query.stages.close.reset();
    query.stop = DistanceBound{1};
    CHECK_THROWS_AS(isonest::extract(store, query, mesh), Error);
    query.stop = TriangleBudgetByDistance{100};
    CHECK_THROWS_AS(isonest::extract(store, query, mesh), Error);
}
