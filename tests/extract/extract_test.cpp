// Surfaces are complete, welded, oriented and within the tolerance, and do not depend on threads,
// chunks or memory.
#include <catch2/catch.hpp>
#include <functional>

#include <isonest/error.h>

#include "store/base/memory.h"
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

template <class T>
Result surface(FunctionVolume<T>& volume, double iso, double error, int chunk = 8,
               const std::optional<WorldBox>& box = {}, int threads = 2,
               std::uint64_t memory = 1U << 30U) {
    const TemporaryFolder folder;
    PreprocessOptions p = with_chunk(chunk);
    p.threads = threads;
    make_store(volume, folder / "s", p);
    const StoreReader store(folder / "s");
    Extraction options;
    options.iso = iso;
    options.error = error;
    options.box = box;
    options.threads = threads;
    options.memory = memory;
    Result r;
    r.report = extract(store, folder / "m.ply", options, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    CHECK(r.mesh.vertices.size() == r.report.vertices);
    CHECK(r.mesh.triangles.size() == r.report.triangles);
    CHECK(r.report.error_bound <= error);
    CHECK(folder.names().size() == 2);  // no other file is left
    return r;
}

template <class T>
void require_whole(FunctionVolume<T>& volume, const Result& r) {
    const Int3 n = volume.nodes();
    const MeshFaults faults = check_mesh(
        r.mesh, {0, 0, 0},
        {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1), static_cast<double>(n.z - 1)});
    CHECK(faults.unused_vertices == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.open_edges_inside == 0);
    CHECK(faults.flat_triangles == r.report.mending.zero_area);
}

/// Checks |U - iso| at the vertices and inside every triangle, and that normals point toward the
/// smaller values.
template <class T>
double residual(const FunctionVolume<T>& volume, const Mesh& mesh, double iso) {
    double worst = 0;
    std::uint64_t seed = 0;
    for (const auto& t : mesh.triangles) {
        for (int k = 0; k < 6; ++k) {
            double a = k < 3 ? (k == 0) : noise({static_cast<std::int64_t>(++seed), 1, k});
            double b = k < 3 ? (k == 1) : noise({static_cast<std::int64_t>(++seed), 2, k});
            if (a + b > 1) {
                a = 1 - a;
                b = 1 - b;
            }
            Double3 p{};
            for (std::size_t i = 0; i < 3; ++i) {
                p[i] = a * mesh.vertices[t[0]][i] + b * mesh.vertices[t[1]][i] +
                       (1 - a - b) * mesh.vertices[t[2]][i];
            }
            worst = std::max(worst, std::fabs(fine_value(volume, p) - iso));
        }
    }
    return worst;
}

double distance(const Int3& p, const Double3& c) {
    return std::hypot(static_cast<double>(p.x) - c[0], static_cast<double>(p.y) - c[1],
                      static_cast<double>(p.z) - c[2]);
}
float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}
std::uint8_t few_levels(const Int3& p) {
    return static_cast<std::uint8_t>(5 * noise(p));
}

}  // namespace

TEST_CASE("a sphere gives one closed surface with the right area") {
    FunctionVolume<float> volume({33, 33, 33}, [](const Int3& p) {
        return static_cast<float>(distance(p, {16.0, 16.0, 16.0}));
    });
    const Result r = surface(volume, 10, 0);
    require_whole(volume, r);
    const auto v = static_cast<std::int64_t>(r.mesh.vertices.size());
    const auto t = static_cast<std::int64_t>(r.mesh.triangles.size());
    CHECK(v - t / 2 == 2);  // Euler characteristic of a sphere
    double area = 0;
    double outward = 0;
    for (const auto& tri : r.mesh.triangles) {
        std::array<Double3, 3> p;
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                p[i][a] = static_cast<double>(r.mesh.vertices[tri[i]][a]) - 16;
            }
        }
        Double3 u{};
        Double3 w{};
        for (std::size_t a = 0; a < 3; ++a) {
            u[a] = p[1][a] - p[0][a];
            w[a] = p[2][a] - p[0][a];
        }
        const Double3 n{u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2],
                        u[0] * w[1] - u[1] * w[0]};
        area += std::hypot(n[0], n[1], n[2]) / 2;
        outward += (n[0] * p[0][0] + n[1] * p[0][1] + n[2] * p[0][2]) / 6;
    }
    CHECK(area == Approx(4 * M_PI * 100).epsilon(0.02));
    // Values grow outward and normals point toward smaller values, inward: the volume is negative.
    CHECK(outward == Approx(-4.0 / 3 * M_PI * 1000).epsilon(0.03));
}

TEST_CASE("surfaces have no cracks and are within the tolerance for every size") {
    for (const Int3& n :
         {Int3{33, 33, 33}, Int3{20, 31, 17}, Int3{2, 2, 2}, Int3{3, 40, 5}, Int3{41, 6, 13}}) {
        FunctionVolume<float> volume(n, smooth_f);
        for (const double iso : {-0.4, 0.1, 0.6}) {
            for (const double error : {0.0, 0.01, 0.05, 0.2, 1.0}) {
                CAPTURE(n.x, n.y, n.z, iso, error);
                const Result r = surface(volume, iso, error);
                require_whole(volume, r);
                CHECK(residual(volume, r.mesh, iso) <= error + 2e-5);
            }
        }
    }
}

TEST_CASE("an isovalue equal to node values gives a manifold without degenerate triangles") {
    for (const Int3& n : {Int3{17, 17, 17}, Int3{12, 9, 20}}) {
        FunctionVolume<std::uint8_t> volume(n, few_levels);
        for (const double iso : {1.0, 2.0, 3.0, 4.0}) {
            for (const double error : {0.0, 1.0, 2.5}) {
                CAPTURE(n.x, iso, error);
                const Result r = surface(volume, iso, error);
                require_whole(volume, r);
                CHECK(r.report.mending.zero_area == 0);
                // Sheets that touch are moved apart.
                const double moved = 3 * r.report.value_range * r.report.coordinate_rounding;
                CHECK(residual(volume, r.mesh, iso) <= error + 1e-4 + moved);
            }
        }
    }
}

TEST_CASE("the two sides of a plateau at the isovalue stay separate") {
    FunctionVolume<float> volume({9, 9, 9}, [](const Int3& p) {
        return p.z == 4 && p.x > 1 && p.x < 7 && p.y > 1 && p.y < 7 ? 1.0F : 0.0F;
    });
    const Result r = surface(volume, 1, 0);
    require_whole(volume, r);
    CHECK(!r.mesh.triangles.empty());
}

TEST_CASE("the mesh has the same bytes for any threads, chunk and memory") {
    FunctionVolume<std::uint8_t> plateaus({45, 38, 51}, few_levels);
    FunctionVolume<float> volume({45, 38, 51}, smooth_f);
    for (const double error : {0.0, 0.05}) {
        const std::string expected = surface(volume, 0.3, error, 16, {}, 1).bytes;
        const std::string plateau = surface(plateaus, 2, 40 * error, 16, {}, 1).bytes;
        for (const int chunk : {8, 32, 64}) {
            for (const int threads : {2, 4}) {
                CHECK(surface(volume, 0.3, error, chunk, {}, threads).bytes == expected);
                CHECK(surface(plateaus, 2, 40 * error, chunk, {}, threads).bytes == plateau);
            }
        }
        CHECK(surface(volume, 0.3, error, 16, {}, 2, 48U << 20U).bytes == expected);
    }
}

TEST_CASE("with the minimum memory the cache stays within it, and the mesh is the same") {
    // More bytes of values than remain of the memory after the libraries.
    FunctionVolume<float> volume({129, 129, 129}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    Extraction options;
    options.iso = 0.3;
    extract(store, folder / "m.ply", options, silent_progress());
    const std::string expected = read_file(folder / "m.ply");
    for (const int threads : {1, 2}) {
        options.threads = threads;
        std::optional<ExtractReport> report;
        for (options.memory = 1U << 20U; !report; options.memory += 1U << 20U) {
            try {
                report = extract(store, folder / "m.ply", options, silent_progress());
            } catch (const Error& e) {
                REQUIRE(e.kind() == ErrorKind::limit);
            }
        }
        CHECK(report->traversal.peak_cache_bytes < options.memory - kLibraryHeap);
        CHECK(report->traversal.peak_cache_bytes < 129 * 129 * 129 * sizeof(float) / 2);
        CHECK(read_file(folder / "m.ply") == expected);
    }
}

TEST_CASE("the store has the same bytes for any threads and memory") {
    FunctionVolume<float> volume({70, 41, 53}, smooth_f);
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(16);
    options.threads = 1;
    make_store(volume, folder / "a", options);
    const std::string expected = read_file(folder / "a");
    for (const int threads : {2, 4}) {
        options.threads = threads;
        make_store(volume, folder / "b", options);
        CHECK(read_file(folder / "b") == expected);
    }
    options.memory = 48U << 20U;
    const auto report = make_store(volume, folder / "b", options);
    CHECK(read_file(folder / "b") == expected);
    CHECK(report.nodes == volume.nodes());
}

TEST_CASE("a box clips the surface at its faces and nowhere else") {
    FunctionVolume<float> volume({33, 29, 31}, smooth_f);
    const WorldBox box{{3.5, 4, 6.25}, {20.75, 21, 27}};
    for (const double error : {0.0, 0.1}) {
        const Result r = surface(volume, 0.1, error, 8, box);
        const MeshFaults faults = check_mesh(r.mesh, box.lo, box.hi);
        CHECK(r.mesh.triangles.size() > 100);
        CHECK(faults.open_edges_inside == 0);
        CHECK(faults.overused_edges == 0);
        CHECK(faults.misoriented_edges == 0);
        for (const auto& v : r.mesh.vertices) {
            for (std::size_t a = 0; a < 3; ++a) {
                REQUIRE(static_cast<double>(v[a]) >= box.lo[a]);
                REQUIRE(static_cast<double>(v[a]) <= box.hi[a]);
            }
        }
        CHECK(residual(volume, r.mesh, 0.1) <= error + 2e-5);
    }
}

TEST_CASE("the error bound in a box ignores what is outside the box") {
    // Linear except for waves at one end, which no large element within the tolerance reaches.
    FunctionVolume<float> volume({33, 33, 33}, [](Int3 n) {
        const double waves = n.x > 20 ? 2 * std::sin(2.0 * static_cast<double>(n.y)) : 0;
        return static_cast<float>(static_cast<double>(n.z) - 16.25 + waves);
    });
    for (const double error : {0.25, 0.5}) {
        const Result part = surface(volume, 0, error, 8, WorldBox{{1, 1, 1}, {7.5, 30, 31}});
        CHECK(surface(volume, 0, error).report.error_bound > 0.01);
        CHECK(part.report.error_bound == part.report.value_rounding);
        CHECK(part.mesh.triangles.size() > 10);
    }
}

TEST_CASE(
    "a surface in a face of the volume or the box is complete, even if other faces clip cells") {
    const auto area = [](const Mesh& mesh) {
        double sum = 0;
        for (const auto& t : mesh.triangles) {
            Double3 p{};
            Double3 q{};
            for (std::size_t i = 0; i < 3; ++i) {
                p[i] = mesh.vertices[t[1]][i] - mesh.vertices[t[0]][i];
                q[i] = mesh.vertices[t[2]][i] - mesh.vertices[t[0]][i];
            }
            sum += std::hypot(p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2],
                              p[0] * q[1] - p[1] * q[0]) /
                   2;
        }
        return sum;
    };
    const Int3 n{8, 7, 6};
    const std::array<double, 3> expected{30, 35, 42};
    for (int axis = 0; axis < 3; ++axis) {
        for (const std::int64_t at : {std::int64_t{0}, n[axis] - 1}) {
            CAPTURE(axis, at);
            FunctionVolume<std::uint8_t> volume(
                n, [&](const Int3& p) { return static_cast<std::uint8_t>(p[axis] == at ? 1 : 0); });
            const Result r = surface(volume, 1, 0.1);
            CHECK(area(r.mesh) == Approx(expected.at(static_cast<std::size_t>(axis))));
            CHECK(check_mesh(r.mesh, {0, 0, 0}, {7, 6, 5}).split_vertices == 0);
            // It faces the boundary face, in which it lies after its coordinates are rounded.
            FunctionVolume<float> inverse(n,
                                          [&](const Int3& p) { return p[axis] == at ? 0 : 1e18F; });
            CHECK(area(surface(inverse, 1, 0.1).mesh) ==
                  Approx(expected.at(static_cast<std::size_t>(axis))));
        }
    }
    // The sheet z = 3 belongs to the cells above it.
    FunctionVolume<std::uint8_t> step(
        n, [](const Int3& p) { return static_cast<std::uint8_t>(p.z <= 3 ? 1 : 0); });
    CHECK(area(surface(step, 1, 0, 8, WorldBox{{0.5, 1, 3}, {4.25, 4, 5}}).mesh) == Approx(11.25));
    CHECK(surface(step, 1, 0, 8, WorldBox{{0.5, 1, 0}, {4.25, 4, 3}}).mesh.triangles.empty());
}

TEST_CASE("flat, constant, missing and outside: an empty mesh, no failure") {
    FunctionVolume<float> one({1, 1, 1}, [](const Int3&) { return 1.0F; });
    FunctionVolume<float> thin({1, 1, 100}, [](const Int3& p) { return static_cast<float>(p.z); });
    FunctionVolume<float> constant({9, 9, 9}, [](const Int3&) { return 3.0F; });
    FunctionVolume<float> missing(
        {9, 9, 9}, [](const Int3&) { return std::numeric_limits<float>::quiet_NaN(); });
    FunctionVolume<float> normal({9, 9, 9}, smooth_f);
    CHECK(surface(one, 0.5, 0).mesh.triangles.empty());
    CHECK(surface(thin, 0.5, 0).mesh.triangles.empty());
    CHECK(surface(constant, 3, 0).mesh.triangles.empty());
    CHECK(surface(constant, 2.5, 0.1).mesh.triangles.empty());
    CHECK(surface(missing, 0.5, 0).mesh.triangles.empty());
    CHECK(surface(normal, 1e9, 0).mesh.triangles.empty());
}

TEST_CASE("no surface next to a missing value, and no cracks elsewhere") {
    FunctionVolume<float> volume({17, 17, 17}, [](const Int3& p) {
        return p == Int3{8, 8, 8} ? std::numeric_limits<float>::quiet_NaN()
                                  : static_cast<float>(p.z) - 8.25F;
    });
    for (const double error : {0.0, 0.5}) {
        const Result r = surface(volume, 0, error);
        const MeshFaults faults = check_mesh(r.mesh, {0, 0, 0}, {16, 16, 16});
        CHECK(faults.overused_edges == 0);
        CHECK(faults.open_edges_inside > 0);
        CHECK(faults.open_edges_inside < 40);
        for (const auto& v : r.mesh.vertices) {
            CHECK(v[2] == Approx(8.25));
            CHECK(std::hypot(v[0] - 8, v[1] - 8) > 0.2);
        }
    }
}

TEST_CASE("extreme integers cross the isovalue at the right position") {
    FunctionVolume<std::int32_t> volume({5, 5, 5}, [](const Int3& p) {
        return p.x < 2 ? std::numeric_limits<std::int32_t>::min()
                       : std::numeric_limits<std::int32_t>::max();
    });
    const Result r = surface(volume, -0.5, 0);
    require_whole(volume, r);
    CHECK(r.mesh.triangles.size() >= 32);
    for (const auto& v : r.mesh.vertices) {
        CHECK(v[0] == Approx(1.5));
    }
    FunctionVolume<double> doubles({3, 3, 3}, [](const Int3& p) {
        return p.x < 1 ? -std::numeric_limits<double>::max() : std::numeric_limits<double>::max();
    });
    for (const auto& v : surface(doubles, 0, 0).mesh.vertices) {
        CHECK(v[0] == Approx(0.5));
    }
}

TEST_CASE("a coarse surface reads few chunks") {
    FunctionVolume<float> volume({257, 129, 129}, [](const Int3& p) {
        return static_cast<float>(distance(p, {128.0, 64.0, 64.0}));
    });
    const Result full = surface(volume, 40, 0, 16);
    const Result coarse = surface(volume, 40, 4, 16);
    CHECK(full.report.traversal.chunks_read < full.report.traversal.chunks_total / 8);
    CHECK(coarse.report.traversal.chunks_read < full.report.traversal.chunks_read / 4);
    CHECK(coarse.mesh.triangles.size() * 10 < full.mesh.triangles.size());
}

TEST_CASE("invalid requests are refused with the right kind of error") {
    FunctionVolume<float> volume({9, 9, 9}, smooth_f);
    const TemporaryFolder folder;
    PreprocessOptions p = with_chunk(8);
    p.fields = {Field::linf_plus};
    make_store(volume, folder / "s", p);
    const StoreReader store(folder / "s");
    const auto kind_of = [&](const Extraction& options) {
        try {
            extract(store, folder / "m.ply", options, silent_progress());
        } catch (const Error& e) {
            return static_cast<int>(e.kind());
        }
        return 0;
    };
    Extraction options;
    CHECK(kind_of(options) == static_cast<int>(ErrorKind::not_found));  // no deviation is stored
    options.indicator = ErrorIndicator::plus;
    CHECK(kind_of(options) == 0);
    options.error = -1;
    CHECK(kind_of(options) == static_cast<int>(ErrorKind::invalid_argument));
    options.error = std::nan("");
    CHECK(kind_of(options) == static_cast<int>(ErrorKind::invalid_argument));
    options.error = 0;
    options.iso = std::numeric_limits<double>::infinity();
    CHECK(kind_of(options) == static_cast<int>(ErrorKind::invalid_argument));
    options.iso = 0;
    options.memory = 1000;
    CHECK(kind_of(options) == static_cast<int>(ErrorKind::limit));
}

TEST_CASE(
    "coordinates and values beyond the range of float32 are refused, not written as infinite") {
    const TemporaryFolder folder;
    const auto refused = [&](const Double3& spacing, double value,
                             const std::function<void(Extraction&)>& change) {
        const Int3 n = {9, 9, 9};
        FunctionVolume<double> volume(n, [&](const Int3& p) { return value * smooth(p); });
        volume.spacing_ = spacing;
        make_store(volume, folder / "s", with_chunk(8));
        const StoreReader store(folder / "s");
        Extraction options;
        change(options);
        // GLB is the only format that cannot hold float64.
        for (const char* const mesh : {"m.glb", "m.ply"}) {
            try {
                extract(store, folder / mesh, options, silent_progress());
            } catch (const Error& e) {
                CHECK(e.kind() == ErrorKind::limit);
                CHECK(!std::filesystem::exists(folder / mesh));
                return std::string(e.what());
            }
        }
        for (const auto& v : read_mesh(folder / "m.ply").vertices) {
            CHECK(std::isfinite(v[0] + v[1] + v[2]));
        }
        std::filesystem::remove(folder / "m.ply");
        std::filesystem::remove(folder / "m.glb");
        return std::string();
    };
    const auto surface = [](Extraction&) {};
    const auto slice = [](Extraction& o) { o.plane = WorldPlane{{0, 0, 1}, 3.5}; };
    using Catch::Matchers::Contains;
    CHECK_THAT(refused({1, 1e38, 1}, 1, surface), Contains("y = 8e+38"));
    CHECK(refused({1, 1e37, 1}, 1, surface).empty());
    CHECK(refused({1, 1, 1}, 1e300, surface).empty());
    CHECK_THAT(refused({1, 1, 1}, 1e300, slice), Contains("values reach"));
    CHECK(refused({1, 1, 1}, 1e30, slice).empty());
}
