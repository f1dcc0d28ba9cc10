// Two-dimensional data: isolines and the graph.
#include <catch2/catch.hpp>
#include <set>

#include <isonest/error.h>

#include "preprocess/sources/wrapping/scaled_source.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

template <class T>
Lines isolines(FunctionVolume<T>& volume, double iso, double error,
               const std::optional<WorldBox>& box = {}, std::uint64_t memory = 1U << 30U) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    Extraction options;
    options.iso = iso;
    options.error = error;
    options.box = box;
    options.memory = memory;
    extract(StoreReader(folder / "s"), folder / "l.obj", options, silent_progress());
    return read_lines(folder / "l.obj");
}

double map(const Int3& p) {
    return smooth(Int3{p.x, p.y, 3}) + 0.05 * noise(Int3{p.x, p.y, 0});
}

template <class T>
Mesh graph(FunctionVolume<T>& volume, double error, double scale = 1) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    Extraction options;
    options.error = error;
    options.graph_scale = scale;
    extract(StoreReader(folder / "s"), folder / "m.ply", options, silent_progress());
    return read_mesh(folder / "m.ply");
}

double plan_area(const Mesh& mesh) {
    double sum = 0;
    for (const auto& t : mesh.triangles) {
        const auto& a = mesh.vertices[t[0]];
        const auto& b = mesh.vertices[t[1]];
        const auto& c = mesh.vertices[t[2]];
        const double twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        CHECK(twice > 0);  // it faces upward
        sum += twice / 2;
    }
    return sum;
}

}  // namespace

TEST_CASE("isolines are within the error and end only on the border") {
    for (const Int3& n : {Int3{33, 33, 1}, Int3{50, 21, 1}, Int3{40, 1, 37}, Int3{1, 20, 45}}) {
        FunctionVolume<double> volume(n, [&](const Int3& p) {
            return n.z == 1 ? map(p) : n.y == 1 ? map({p.x, p.z, 0}) : map({p.y, p.z, 0});
        });
        std::size_t before = std::numeric_limits<std::size_t>::max();
        for (const double error : {0.0, 0.1, 0.4}) {
            CAPTURE(n.x, n.y, n.z, error);
            const Lines lines = isolines(volume, 0.3, error);
            REQUIRE(!lines.segments.empty());
            CHECK(lines.segments.size() <= before);
            before = lines.segments.size();
            std::map<std::size_t, int> uses;
            double worst = 0;
            for (const auto& s : lines.segments) {
                ++uses[s[0]];
                ++uses[s[1]];
                for (const double t : {0.0, 0.35, 1.0}) {
                    Double3 p{};
                    for (std::size_t a = 0; a < 3; ++a) {
                        p[a] = lines.points[s[0]][a] +
                               t * (lines.points[s[1]][a] - lines.points[s[0]][a]);
                    }
                    worst = std::max(worst, std::fabs(fine_value(volume, p) - 0.3));
                }
            }
            CHECK(worst <= error + 1e-5);
            std::size_t open = 0;
            for (const auto& [vertex, count] : uses) {
                bool border = false;
                for (int a = 0; a < 3; ++a) {
                    const double x = lines.points[vertex][static_cast<std::size_t>(a)];
                    border = border || (n[a] > 1 && (x == 0 || x == static_cast<double>(n[a] - 1)));
                }
                open += count == 1 && !border ? 1 : 0;
            }
            CHECK(open == 0);
            CHECK(uses.size() == lines.points.size());
        }
    }
}

TEST_CASE("isolines of integers pass through nodes without gaps") {
    FunctionVolume<std::uint8_t> volume({30, 30, 1}, [](const Int3& p) {
        return static_cast<std::uint8_t>(std::lround(10 + 3 * smooth(Int3{p.x, p.y, 0})));
    });
    const Lines lines = isolines(volume, 11, 0);
    REQUIRE(!lines.segments.empty());
    std::map<std::size_t, int> uses;
    for (const auto& s : lines.segments) {
        CHECK(s[0] != s[1]);
        ++uses[s[0]];
        ++uses[s[1]];
    }
    for (const auto& [vertex, count] : uses) {
        const Double3& p = lines.points[vertex];
        const bool border = p[0] == 0 || p[1] == 0 || p[0] == 29 || p[1] == 29;
        CHECK((border || count % 2 == 0));
    }
}

TEST_CASE("an isoline along the border is complete, even if another border clips cells") {
    for (const int axis : {0, 1}) {
        for (const std::int64_t at : {std::int64_t{0}, std::int64_t{6}}) {
            CAPTURE(axis, at);
            FunctionVolume<std::uint8_t> volume({7, 7, 1}, [&](const Int3& p) {
                return static_cast<std::uint8_t>(p[axis] == at ? 1 : 0);
            });
            const Lines lines = isolines(volume, 1, 0.1);
            double length = 0;
            for (const auto& s : lines.segments) {
                const Double3& p = lines.points[s[0]];
                const Double3& q = lines.points[s[1]];
                length += std::hypot(p[0] - q[0], p[1] - q[1]);
            }
            CHECK(length == Approx(6));
        }
    }
}

TEST_CASE("isolines are clipped at a box") {
    FunctionVolume<double> volume({33, 33, 1}, [](const Int3& p) {
        return static_cast<double>(p.x) + 0.01 * static_cast<double>(p.y);
    });
    const Lines lines = isolines(volume, 10.03, 0, WorldBox{{2, 5.5, -1}, {20, 12.25, 1}});
    double low = 1e9;
    double high = -1e9;
    double length = 0;
    for (const auto& s : lines.segments) {
        const Double3& a = lines.points[s[0]];
        const Double3& b = lines.points[s[1]];
        low = std::min({low, a[1], b[1]});
        high = std::max({high, a[1], b[1]});
        length += std::fabs(a[1] - b[1]);
    }
    CHECK(low == Approx(5.5));
    CHECK(high == Approx(12.25));
    CHECK(length == Approx(6.75));
}

TEST_CASE("the graph covers the plane, has no cracks and is within the error") {
    for (const Int3& n : {Int3{33, 33, 1}, Int3{50, 21, 1}, Int3{2, 9, 1}}) {
        FunctionVolume<double> volume(n, map);
        for (const double error : {0.0, 0.1, 0.4}) {
            CAPTURE(n.x, n.y, error);
            const Mesh mesh = graph(volume, error, 2);
            CHECK(plan_area(mesh) == Approx(static_cast<double>((n.x - 1) * (n.y - 1))));
            const MeshFaults faults =
                check_mesh(mesh, {0, 0, -1e9},
                           {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1), 1e9});
            CHECK(faults.open_edges_inside == 0);
            CHECK(faults.overused_edges == 0);
            CHECK(faults.misoriented_edges == 0);
            if (error == 0) {
                CHECK(mesh.vertices.size() == static_cast<std::size_t>(n.product()));
            }
            double worst = 0;
            for (const auto& t : mesh.triangles) {
                Double3 p{};
                for (std::size_t a = 0; a < 3; ++a) {
                    p[a] = (0.2 * mesh.vertices[t[0]][a] + 0.3 * mesh.vertices[t[1]][a] +
                            0.5 * mesh.vertices[t[2]][a]);
                }
                worst = std::max(worst, std::fabs(p[2] / 2 - fine_value(volume, {p[0], p[1], 0})));
            }
            CHECK(worst <= error + 1e-5);
        }
    }
}

TEST_CASE("a graph beyond the range of float32 is refused, and written with another scale") {
    FunctionVolume<double> volume({9, 9, 1}, [](const Int3& p) { return 1e300 * map(p); });
    CHECK_THROWS_AS(graph(volume, 0), Error);
    for (const auto& v : graph(volume, 0, 1e-299).vertices) {
        CHECK(std::fabs(v[2]) < 100);
    }
}

TEST_CASE("missing values leave holes in the graph, and --missing declares integers as missing") {
    auto inner = std::make_unique<FunctionVolume<std::int16_t>>(Int3{20, 20, 1}, [](const Int3& p) {
        return static_cast<std::int16_t>(p.x >= 5 && p.x <= 8 && p.y >= 5 && p.y <= 9 ? -32768
                                                                                      : p.x * p.y);
    });
    const auto source = with_missing(std::move(inner), -32768);
    CHECK(source->describe().type == ValueType::f32);
    const TemporaryFolder folder;
    preprocess(*source, folder / "s", with_chunk(8), silent_progress());
    Extraction options;
    options.graph_scale = 1;
    options.error = 3;
    extract(StoreReader(folder / "s"), folder / "m.ply", options, silent_progress());
    // Every triangle with a missing corner is gone: the surrounding 5 x 6 cells, except half a cell
    // at a corner whose diagonal avoids the missing node.
    const double left = plan_area(read_mesh(folder / "m.ply")) - (19.0 * 19 - 5 * 6);
    CHECK(left >= 0);
    CHECK(left <= 2);
}

TEST_CASE("a missing value that the type cannot hold is refused") {
    auto inner = std::make_unique<FunctionVolume<std::uint8_t>>(
        Int3{2, 2, 2}, [](const Int3&) { return std::uint8_t{0}; });
    CHECK_THROWS(with_missing(std::move(inner), -1));
}

TEST_CASE("a graph's bound includes the rounding of its heights to float32") {
    FunctionVolume<double> volume({20, 17, 1}, [](const Int3& p) {
        return 1e9 + static_cast<double>((3 * p.x + 5 * p.y) % 4);
    });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    for (const bool boxed : {false, true}) {
        for (const double scale : {1.0, 0.3, -2e-9}) {
            Extraction options;
            options.graph_scale = scale;
            if (boxed) {
                options.box = WorldBox{{2.3, 3.1, -1e30}, {15.7, 12.9, 1e30}};
            }
            const ExtractReport report =
                extract(store, folder / "m.ply", options, silent_progress());
            const Mesh mesh = read_mesh(folder / "m.ply");
            double worst = 0;
            for (const auto& v : mesh.vertices) {
                const Double3 at{static_cast<double>(v[0]), static_cast<double>(v[1]), 0};
                worst = std::max(
                    worst, std::fabs(static_cast<double>(v[2]) / scale - fine_value(volume, at)));
            }
            CAPTURE(boxed, scale, worst);
            CHECK(worst > 0);
            CHECK(worst <= report.error_bound + 1e-5);
            CHECK(report.error_bound == report.value_rounding);
            CHECK(report.error_bound < 256);
        }
    }
}
