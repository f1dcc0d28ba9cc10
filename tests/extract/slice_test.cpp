// Slices: complete, in their plane, and with the data's values within the error.
#include <catch2/catch.hpp>
#include <set>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

struct Slice {
    Mesh mesh;
    ExtractReport report;
};

template <class T>
Slice slice(FunctionVolume<T>& volume, const WorldPlane& plane, double error, int chunk = 8) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(chunk));
    const StoreReader store(folder / "s");
    Extraction options;
    options.plane = plane;
    options.error = error;
    Slice s;
    s.report = extract(store, folder / "m.ply", options, silent_progress());
    s.mesh = read_mesh(folder / "m.ply");
    CHECK(s.report.error_bound - s.report.value_rounding <= error);
    CHECK(s.report.value_rounding <=
          1e-6 * (std::fabs(store.max_value()) + std::fabs(store.min_value())));
    return s;
}

double area(const Mesh& mesh) {
    double sum = 0;
    for (const auto& t : mesh.triangles) {
        Double3 a{};
        Double3 b{};
        for (std::size_t i = 0; i < 3; ++i) {
            a[i] = mesh.vertices[t[1]][i] - mesh.vertices[t[0]][i];
            b[i] = mesh.vertices[t[2]][i] - mesh.vertices[t[0]][i];
        }
        sum += std::hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                          a[0] * b[1] - a[1] * b[0]) /
               2;
    }
    return sum;
}

/// The largest difference between a slice's values and the data, inside its triangles.
template <class T>
double residual(const FunctionVolume<T>& volume, const Mesh& mesh) {
    double worst = 0;
    for (const auto& t : mesh.triangles) {
        for (int i = 0; i <= 3; ++i) {
            for (int j = 0; i + j <= 3; ++j) {
                const std::array<double, 3> w{i / 3.0, j / 3.0, (3 - i - j) / 3.0};
                Double3 p{};
                double value = 0;
                for (std::size_t c = 0; c < 3; ++c) {
                    value += w[c] * mesh.attributes[t[c]][0];
                    for (std::size_t a = 0; a < 3; ++a) {
                        p[a] += w[c] * mesh.vertices[t[c]][a] / volume.spacing_[a];
                    }
                }
                worst = std::max(worst, std::fabs(value - fine_value(volume, p)));
            }
        }
    }
    return worst;
}

double smooth_value(const Int3& p) {
    return smooth(p);
}

}  // namespace

TEST_CASE("a slice covers its plane and has the data's values within the error") {
    FunctionVolume<double> volume({29, 34, 23}, smooth_value);
    volume.spacing_ = {1, 0.5, 1.5};
    // World extent 28 x 16.5 x 33: the area of each plane's polygon, computed by hand.
    struct Case {
        WorldPlane plane;
        double area;
    };
    const std::vector<Case> cases{{{{0, 0, 1}, 12.3}, 28 * 16.5},
                                  {{{0, 1, 0}, 4.5}, 28 * 33},  // through nodes
                                  {{{1, 0, 0}, 0}, 16.5 * 33},  // at the border
                                  {{{0, 0, 2}, 66}, 28 * 16.5},
                                  {{{-1, 0, 0}, -28}, 16.5 * 33},
                                  {{{33, 0, -28}, 0}, std::hypot(28, 33) * 16.5}};
    for (const Case& c : cases) {
        for (const double error : {0.0, 0.05, 0.5}) {
            CAPTURE(c.plane.normal[0], c.plane.normal[1], c.plane.normal[2], c.plane.offset, error);
            const Slice s = slice(volume, c.plane, error);
            REQUIRE(!s.mesh.triangles.empty());
            CHECK(area(s.mesh) == Approx(c.area).epsilon(1e-5));
            CHECK(residual(volume, s.mesh) <= error + 1e-5);
            const MeshFaults faults = check_mesh(s.mesh, {0, 0, 0}, {28, 16.5, 33});
            CHECK(faults.open_edges_inside == 0);
            CHECK(faults.overused_edges == 0);
            CHECK(faults.misoriented_edges == 0);
            double off = 0;
            for (const auto& v : s.mesh.vertices) {
                const Double3& n = c.plane.normal;
                off = std::max(off,
                               std::fabs(n[0] * v[0] + n[1] * v[1] + n[2] * v[2] - c.plane.offset) /
                                   std::hypot(n[0], n[1], n[2]));
            }
            CHECK(off < 1e-4);
        }
    }
}

TEST_CASE("a slice through nodes has two triangles for each square") {
    FunctionVolume<double> volume({29, 34, 23}, smooth_value);
    for (const double z : {0.0, 7.0, 12.0, 22.0}) {
        const Slice s = slice(volume, {{0, 0, 1}, z}, 0);
        CHECK(s.mesh.triangles.size() == 2 * 28 * 33);
        CHECK(s.mesh.vertices.size() == 29 * 34);
    }
}

TEST_CASE("a slice with a larger error has fewer triangles; missing data leave holes") {
    FunctionVolume<float> volume({33, 33, 33}, [](const Int3& p) {
        return p.x > 20 && p.y > 20 ? std::numeric_limits<float>::quiet_NaN()
                                    : static_cast<float>(smooth(p));
    });
    const Slice full = slice(volume, {{0, 0, 1}, 10.5}, 0);
    const Slice coarse = slice(volume, {{0, 0, 1}, 10.5}, 0.3);
    CHECK(coarse.mesh.triangles.size() * 3 < full.mesh.triangles.size());
    CHECK(area(full.mesh) == Approx(32.0 * 32 - 12 * 12));
    CHECK(area(coarse.mesh) == Approx(32.0 * 32 - 12 * 12));
}

TEST_CASE("a plane outside the volume gives an empty slice") {
    FunctionVolume<float> volume({9, 9, 9}, [](const Int3& p) { return static_cast<float>(p.x); });
    CHECK(slice(volume, {{0, 0, 1}, 8.01}, 0).mesh.triangles.empty());
    CHECK(slice(volume, {{1, 1, 1}, -0.1}, 0).mesh.triangles.empty());
}

namespace {

Lines contours(FunctionVolume<double>& volume, const WorldPlane& plane, double error,
               const std::vector<double>& values) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    Extraction options;
    options.plane = plane;
    options.error = error;
    options.contours = values;
    options.memory = 64U << 20U;
    extract(StoreReader(folder / "s"), folder / "l.obj", options, silent_progress());
    return read_lines(folder / "l.obj");
}

}  // namespace

TEST_CASE(
    "contour lines lie in the slice, have their value within the error, and have no loose ends") {
    FunctionVolume<double> volume({29, 34, 23}, smooth_value);
    const std::vector<WorldPlane> planes{
        {{0, 0, 1}, 7.3}, {{0, 1, 0}, 9}, {{1, 0, 0}, 0}, {{1, 2, -1}, 20.2}};
    for (const WorldPlane& plane : planes) {
        for (const double error : {0.0, 0.2}) {
            CAPTURE(plane.normal[0], plane.normal[1], plane.normal[2], plane.offset, error);
            const Lines c = contours(volume, plane, error, {0.25});
            REQUIRE(!c.segments.empty());
            double worst = 0;
            double off = 0;
            std::vector<int> uses(c.points.size(), 0);
            for (const auto& line : c.segments) {
                ++uses[line[0]];
                ++uses[line[1]];
                for (const double t : {0.0, 0.4, 1.0}) {
                    Double3 p{};
                    for (std::size_t a = 0; a < 3; ++a) {
                        p[a] = c.points[line[0]][a] +
                               t * (c.points[line[1]][a] - c.points[line[0]][a]);
                    }
                    worst = std::max(worst, std::fabs(fine_value(volume, p) - 0.25));
                    off = std::max(off, std::fabs(plane.normal[0] * p[0] + plane.normal[1] * p[1] +
                                                  plane.normal[2] * p[2] - plane.offset));
                }
            }
            CHECK(worst <= error + 1e-4);
            CHECK(off < 1e-4);
            for (std::size_t i = 0; i < uses.size(); ++i) {
                bool border = false;
                for (std::size_t a = 0; a < 3; ++a) {
                    const double last = std::array<double, 3>{28, 33, 22}[a];
                    border = border || c.points[i][a] < 1e-4 || c.points[i][a] > last - 1e-4;
                }
                CHECK((uses[i] == 2 || (border && uses[i] == 1)));
            }
        }
    }
}

TEST_CASE("many contour lines are the same as those of each value alone") {
    FunctionVolume<double> volume({40, 40, 20}, smooth_value);
    std::vector<double> values;
    values.reserve(150);
    for (int i = 0; i < 150; ++i) {
        values.push_back(-1.5 + 0.0201 * i);
    }
    const WorldPlane plane{{0, 0.2, 1}, 9.5};
    const Lines all = contours(volume, plane, 0, values);
    CHECK(all.points.size() > 20000);  // more than one part
    std::size_t lines = 0;
    std::size_t points = 0;
    for (const double value : {values[3], values[70], values[149]}) {
        const Lines one = contours(volume, plane, 0, {value});
        lines += one.segments.size();
        points += one.points.size();
        const std::set<Double3> there(all.points.begin(), all.points.end());
        for (const Double3& p : one.points) {
            CHECK(there.count(p) == 1);
        }
    }
    std::size_t again = 0;
    std::size_t again_points = 0;
    const Lines three = contours(volume, plane, 0, {values[3], values[70], values[149]});
    again = three.segments.size();
    again_points = three.points.size();
    CHECK(again == lines);
    CHECK(again_points == points);
}

namespace {

/// Values that float32 cannot represent: integers that differ in their last bits.
template <class T>
FunctionVolume<T> far_from_zero(const Int3& nodes, double base, double step) {
    return FunctionVolume<T>(nodes, [=](const Int3& p) {
        return static_cast<T>(base + step * static_cast<double>((3 * p.x + 5 * p.y + 7 * p.z) % 4));
    });
}

template <class T>
void require_within_bound(FunctionVolume<T> volume, const WorldPlane& plane, double error,
                          double most) {
    const Slice s = slice(volume, plane, error);
    REQUIRE(!s.mesh.triangles.empty());
    CHECK(s.report.value_rounding <= most);
    CHECK(residual(volume, s.mesh) <= s.report.error_bound + most);
}

}  // namespace

TEST_CASE("a slice of values beyond float32's precision is within the printed bound") {
    const Int3 n{9, 10, 8};
    for (const double error : {0.0, 1.5}) {
        for (const WorldPlane& plane :
             {WorldPlane{{0, 0, 1}, 4}, WorldPlane{{0, 0, 1}, 3.4}, WorldPlane{{1, 2, 1}, 13}}) {
            CAPTURE(error, plane.offset);
            require_within_bound(far_from_zero<double>(n, 1e9, 1), plane, error, 1e-5);
            require_within_bound(far_from_zero<std::uint32_t>(n, 4e9, 1), plane, error, 1e-5);
            require_within_bound(far_from_zero<std::int32_t>(n, -2e9, 3), plane, error, 1e-5);
            require_within_bound(far_from_zero<double>(n, 1e300, 1e286), plane, error, 1e286);
            require_within_bound(far_from_zero<std::uint8_t>(n, 252, 1), plane, error, 1e-4);
            require_within_bound(far_from_zero<float>(n, 1e6, 0.25), plane, error, 0.25);
        }
    }
}

TEST_CASE("a slice through nodes has exactly their values") {
    auto volume = far_from_zero<double>({9, 10, 8}, 1e15, 0.125);
    const Slice s = slice(volume, {{0, 0, 1}, 4}, 0);
    CHECK(s.report.error_bound == 0);
    for (std::size_t i = 0; i < s.mesh.vertices.size(); ++i) {
        const auto& v = s.mesh.vertices[i];
        CHECK(s.mesh.attributes[i][0] ==
              fine_value(volume, {static_cast<double>(v[0]), static_cast<double>(v[1]),
                                  static_cast<double>(v[2])}));
    }
}

TEST_CASE("a mesh in a float32-only format reports its rounding") {
    auto volume = far_from_zero<double>({9, 10, 8}, 1e9, 1);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    Extraction options;
    options.plane = WorldPlane{{0, 0, 1}, 4};
    const ExtractReport report = extract(store, folder / "m.glb", options, silent_progress());
    CHECK(report.value_rounding >= 1);
    CHECK(report.value_rounding <= 32);
    CHECK(report.error_bound == report.value_rounding);
}

TEST_CASE(
    "the reported error of a slice clipped by the box is the same for any threads and memory") {
    // Values are rounded at edges and, where the box clips a triangle, once more.
    FunctionVolume<double> volume(
        {41, 38, 35}, [](const Int3& p) { return 1e7 * (smooth(p) + 0.01 * noise(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    Extraction options;
    options.plane = WorldPlane{{1, 0.4, 0.7}, 31.3};
    options.box = WorldBox{{2.3, 1.7, 3.1}, {37.9, 33.3, 30.7}};
    for (const double error : {0.0, 1e6}) {
        options.error = error;
        options.threads = 1;
        options.memory = std::uint64_t{1} << 30U;
        // For GLB, which only has float32.
        const ExtractReport one = extract(store, folder / "m.glb", options, silent_progress());
        CHECK(one.value_rounding > 0);
        const std::string bytes = read_file(folder / "m.glb");
        for (int threads = 1; threads <= 8; ++threads) {
            for (const std::uint64_t memory : {24U, 64U, 1024U}) {
                CAPTURE(error, threads, memory);
                options.threads = threads;
                options.memory = memory << 20U;
                const ExtractReport other =
                    extract(store, folder / "m.glb", options, silent_progress());
                CHECK(other.value_rounding == one.value_rounding);
                CHECK(other.error_bound == one.error_bound);
                CHECK(read_file(folder / "m.glb") == bytes);
            }
        }
    }
}

TEST_CASE("contour lines of values beyond float32's precision lie in the right place") {
    // Values vary only along x: the line of 1e9 + 2.5 is x = 2.5.
    FunctionVolume<double> volume({9, 10, 8},
                                  [](const Int3& p) { return 1e9 + static_cast<double>(p.x); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    Extraction options;
    options.plane = WorldPlane{{0, 0, 1}, 4};
    options.contours = {1e9 + 2.5};
    const ExtractReport report = extract(store, folder / "l.obj", options, silent_progress());
    CHECK(report.error_bound <= 1e-6);
    const Lines lines = read_lines(folder / "l.obj");
    REQUIRE(!lines.points.empty());
    for (const auto& p : lines.points) {
        CHECK(p[0] == Approx(2.5));
    }
}
