// Surfaces of hexahedral cells: closed, manifold, independent of threads, memory and chunks, and
// equal to an explicit marching of the cells.
#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

#include <isonest/error.h>

#include "query/march/cube_cases.h"
#include "query/march/march_hexahedron.h"
#include "query/values/topology.h"
#include "tests/support/test_support.h"
#include "tests/support/whole_mesh.h"

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
Result surface(FunctionVolume<T>& volume, double iso, const How& how = {},
               const std::optional<WorldBox>& box = {}, Cells cells = Cells::hexahedra) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(how.chunk));
    const StoreReader store(folder / "s");
    Extraction e;
    e.iso = iso;
    e.cells = cells;
    e.box = box;
    e.threads = how.threads;
    e.memory = how.memory;
    e.normals = how.chunk == 4;
    Result r;
    r.report = extract(store, folder / "m.ply", e, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    return r;
}

Double3 last_of(const Int3& n) {
    return {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1),
            static_cast<double>(n.z - 1)};
}

double area_of(const Mesh& mesh, const std::array<std::uint32_t, 3>& t) {
    Double3 a{};
    Double3 b{};
    for (std::size_t i = 0; i < 3; ++i) {
        const double p = mesh.vertices[t[0]][i];
        a[i] = mesh.vertices[t[1]][i] - p;
        b[i] = mesh.vertices[t[2]][i] - p;
    }
    const double x = a[1] * b[2] - a[2] * b[1];
    const double y = a[2] * b[0] - a[0] * b[2];
    const double z = a[0] * b[1] - a[1] * b[0];
    return std::sqrt(x * x + y * y + z * z) / 2;
}

float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}
float rough(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.3 * noise(p));
}
float pure_noise(const Int3& p) {
    return static_cast<float>(noise(p));
}

/// For both cells at a face, the sides of the surface in the face, as pairs of edges' midpoints in
/// the unit square, in order.
using FaceSides = std::set<std::array<std::int64_t, 2>>;

FaceSides sides_in(const HexahedronCase& c, unsigned face, bool reversed) {
    FaceSides sides;
    for (std::size_t p = 0; p < c.polygons; ++p) {
        const std::size_t first = c.first[p];
        const std::size_t size = c.first[p + 1] - first;
        for (std::size_t i = 0; i < size; ++i) {
            if (c.face[first + i] != face) {
                continue;
            }
            std::array<std::int64_t, 2> side{};
            for (std::size_t end = 0; end < 2; ++end) {
                Int3 at =
                    Int3{3, 3, 3}.unlinear(kCubeEdge[c.edge[first + (i + end) % size]].midpoint);
                at[static_cast<int>(face / 2)] = 0;
                side[end] = Int3{3, 3, 3}.linear(at);
            }
            if (reversed) {
                std::swap(side[0], side[1]);
            }
            sides.insert(side);
        }
    }
    return sides;
}

/// An explicit marching of all cells by the table; cells do not share vertices.
template <class T>
std::multiset<std::array<std::array<float, 3>, 3>> by_cells(const FunctionVolume<T>& volume,
                                                            double iso) {
    std::multiset<std::array<std::array<float, 3>, 3>> triangles;
    const Int3 cells = volume.nodes() - Int3{1, 1, 1};
    for (std::int64_t i = 0; i < cells.product(); ++i) {
        const Int3 low = cells.unlinear(i);
        unsigned below = 0;
        for (unsigned corner = 0; corner < 8; ++corner) {
            below |= (volume.at(low + corner_offset(corner)) < iso ? 1U : 0U) << corner;
        }
        const HexahedronCase& c = hexahedron_cases()[below];
        for (std::size_t t = 0; t < c.triangles; ++t) {
            std::array<std::array<float, 3>, 3> triangle{};
            for (std::size_t k = 0; k < 3; ++k) {
                const CubeEdge& e = kCubeEdge[c.edge[c.triangle[t][k]]];
                const Int3 a = low + corner_offset(e.low);
                const Int3 b = low + corner_offset(e.high);
                const double s = (iso - volume.at(a)) / (volume.at(b) - volume.at(a));
                for (int axis = 0; axis < 3; ++axis) {
                    triangle[k][static_cast<std::size_t>(axis)] = static_cast<float>(
                        static_cast<double>(a[axis]) + s * static_cast<double>(b[axis] - a[axis]));
                }
            }
            std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                        triangle.end());
            triangles.insert(triangle);
        }
    }
    return triangles;
}

}  // namespace

TEST_CASE("each case of a hexahedral cell consists of discs that separate its corners") {
    for (unsigned below = 0; below < 256; ++below) {
        CAPTURE(below);
        const HexahedronCase& c = hexahedron_cases()[below];
        std::set<std::uint8_t> crossed;
        for (std::size_t e = 0; e < kCubeEdges; ++e) {
            const CubeEdge& edge = kCubeEdge[e];
            const bool of_cube = ((edge.low ^ edge.high) & ((edge.low ^ edge.high) - 1U)) == 0;
            if (of_cube && ((below >> edge.low ^ below >> edge.high) & 1U) != 0) {
                crossed.insert(static_cast<std::uint8_t>(e));
            }
        }
        REQUIRE(c.edges == crossed.size());
        REQUIRE(std::set<std::uint8_t>(c.edge.begin(), c.edge.begin() + c.edges) == crossed);
        REQUIRE(c.first[c.polygons] == c.edges);
        // A disc of n corners has n - 2 triangles. Each side of a polygon is used once. All other
        // sides of triangles are used twice, in opposite directions, and are not in a face.
        REQUIRE(c.triangles == c.edges - 2 * c.polygons);
        std::map<std::array<std::uint8_t, 2>, int> sides;
        for (std::size_t t = 0; t < c.triangles; ++t) {
            for (std::size_t i = 0; i < 3; ++i) {
                ++sides[{c.triangle[t][i], c.triangle[t][(i + 1) % 3]}];
            }
        }
        std::size_t own = 0;
        for (const auto& [side, times] : sides) {
            REQUIRE(times == 1);
            if (!sides.contains({side[1], side[0]})) {
                ++own;
                continue;
            }
            const unsigned a = faces_at(kCubeEdge[c.edge[side[0]]]);
            REQUIRE((a & faces_at(kCubeEdge[c.edge[side[1]]])) == 0);
        }
        REQUIRE(own == c.edges);
        for (std::size_t p = 0; p < c.polygons; ++p) {
            for (std::size_t i = c.first[p]; i < c.first[p + 1]; ++i) {
                const auto next =
                    static_cast<std::uint8_t>(i + 1 == c.first[p + 1] ? c.first[p] : i + 1);
                REQUIRE(sides.contains({static_cast<std::uint8_t>(i), next}));
                const unsigned faces =
                    faces_at(kCubeEdge[c.edge[i]]) & faces_at(kCubeEdge[c.edge[next]]);
                REQUIRE((faces >> c.face[i] & 1U) != 0);
            }
        }
    }
}

TEST_CASE("two adjacent hexahedral cells have the same sides in their common face") {
    for (unsigned axis = 0; axis < 3; ++axis) {
        for (unsigned low = 0; low < 256; ++low) {
            for (unsigned high = 0; high < 256; ++high) {
                bool agree = true;
                for (unsigned corner = 0; corner < 8; ++corner) {
                    agree = agree && ((corner >> axis & 1U) != 0 ||
                                      (low >> (corner | 1U << axis) & 1U) == (high >> corner & 1U));
                }
                if (agree) {
                    REQUIRE(sides_in(hexahedron_cases()[low], 2 * axis + 1, false) ==
                            sides_in(hexahedron_cases()[high], 2 * axis, true));
                }
            }
        }
    }
}

TEST_CASE("a polygon is triangulated by the shortest allowed diagonals, or not at all") {
    const auto by = [](const auto& cost) {
        std::set<std::array<std::size_t, 3>> triangles;
        const bool done =
            triangulate_polygon(5, cost, [&](std::size_t i, std::size_t j, std::size_t k) {
                triangles.insert({i, j, k});
            });
        CHECK(triangles.size() == (done ? 3U : 0U));
        return triangles;
    };
    using Triangles = std::set<std::array<std::size_t, 3>>;
    constexpr double kNever = std::numeric_limits<double>::infinity();
    CHECK(by([](std::size_t i, std::size_t j) { return i == 2 || j == 2 ? 1.0 : 5.0; }) ==
          Triangles{{0, 1, 2}, {2, 3, 4}, {0, 2, 4}});
    CHECK(by([&](std::size_t i, std::size_t j) { return i == 3 || j == 3 ? 9.0 : kNever; }) ==
          Triangles{{0, 1, 3}, {1, 2, 3}, {0, 3, 4}});
    CHECK(by([&](std::size_t i, std::size_t) { return i == 1 ? 1.0 : kNever; }) ==
          Triangles{{1, 2, 3}, {1, 3, 4}, {0, 1, 4}});
    CHECK(by([&](std::size_t i, std::size_t) { return i == 2 ? 1.0 : kNever; }).empty());
}

TEST_CASE("a surface of hexahedral cells is the welded surface of the individual cells") {
    for (const Int3& n :
         {Int3{17, 17, 17}, Int3{20, 31, 18}, Int3{2, 2, 2}, Int3{3, 40, 5}, Int3{41, 6, 13}}) {
        for (const auto function : {smooth_f, rough, pure_noise}) {
            FunctionVolume<float> volume(n, function);
            for (const double iso : {-0.4, 0.13, 0.5}) {
                CAPTURE(n.x, n.y, n.z, iso);
                const Result r = surface(volume, iso);
                require_whole(r.mesh, {0, 0, 0}, last_of(n));
                const auto expected = by_cells(volume, iso);
                REQUIRE(r.mesh.triangles.size() == expected.size());
                double most = 0;
                std::multiset<std::array<std::array<float, 3>, 3>> found;
                for (const auto& t : r.mesh.triangles) {
                    std::array<std::array<float, 3>, 3> triangle{
                        r.mesh.vertices[t[0]], r.mesh.vertices[t[1]], r.mesh.vertices[t[2]]};
                    std::rotate(triangle.begin(),
                                std::min_element(triangle.begin(), triangle.end()), triangle.end());
                    found.insert(triangle);
                }
                auto other = expected.begin();
                for (const auto& t : found) {
                    for (std::size_t i = 0; i < 9; ++i) {
                        most = std::max(most, std::fabs(static_cast<double>(t[i / 3][i % 3]) -
                                                        (*other)[i / 3][i % 3]));
                    }
                    ++other;
                }
                CHECK(most < 1e-5);
            }
        }
    }
}

TEST_CASE(
    "a surface of hexahedral cells through nodes is a manifold without degenerate triangles") {
    for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6}) {
        for (const int levels : {2, 3, 5, 9}) {
            for (const Int3& n : {Int3{14, 13, 15}, Int3{2, 2, 2}, Int3{5, 18, 3}}) {
                FunctionVolume<std::uint8_t> volume(n, [&](const Int3& p) {
                    return static_cast<std::uint8_t>(levels * noise(p, seed));
                });
                for (int iso = 1; iso < levels; ++iso) {
                    CAPTURE(seed, levels, n.x, iso);
                    const Result r = surface(volume, iso);
                    require_whole(r.mesh, {0, 0, 0}, last_of(n));
                    double least = 1;
                    for (const auto& t : r.mesh.triangles) {
                        least = std::min(least, area_of(r.mesh, t));
                    }
                    CHECK(least > 1e-3);
                    CHECK(r.report.mending.mended == 0);
                }
            }
        }
    }
}

TEST_CASE("a surface of hexahedral cells along faces and edges of the grid") {
    // Steps, so that the surface lies in faces and turns at their edges and corners.
    FunctionVolume<std::uint8_t> volume({16, 16, 16}, [](const Int3& p) {
        const Int3 q{p.x / 3, p.y / 4, p.z / 2};
        return static_cast<std::uint8_t>((q.x + q.y + q.z) % 3);
    });
    for (const double iso : {0.5, 1.0, 1.5, 2.0}) {
        const Result r = surface(volume, iso);
        require_whole(r.mesh, {0, 0, 0}, {15, 15, 15});
        for (const auto& t : r.mesh.triangles) {
            REQUIRE(area_of(r.mesh, t) > 1e-3);
        }
    }
}

TEST_CASE("a closed surface of hexahedral cells has the Euler characteristic of spheres") {
    FunctionVolume<float> volume({40, 40, 40}, [](const Int3& p) {
        const auto ball = [&](double x, double y, double z, double r) {
            return r - std::hypot(static_cast<double>(p.x) - x, static_cast<double>(p.y) - y,
                                  static_cast<double>(p.z) - z);
        };
        return static_cast<float>(std::max(ball(12, 12, 12, 7.3), ball(27, 27, 27, 9.1)));
    });
    const Result r = surface(volume, 0);
    require_whole(r.mesh, {-1, -1, -1}, {-1, -1, -1});
    CHECK(r.mesh.vertices.size() == r.mesh.triangles.size() / 2 + 4);
    double volume_within = 0;
    for (const auto& t : r.mesh.triangles) {
        const auto& a = r.mesh.vertices[t[0]];
        const auto& b = r.mesh.vertices[t[1]];
        const auto& c = r.mesh.vertices[t[2]];
        volume_within += (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                          a[2] * (b[0] * c[1] - b[1] * c[0])) /
                         6.0;
    }
    constexpr double kPi = 3.14159265358979;
    CHECK(volume_within ==
          Approx(4 * kPi / 3 * (std::pow(7.3, 3) + std::pow(9.1, 3))).epsilon(0.02));
}

TEST_CASE(
    "hexahedral cells with a missing corner have no surface, and other cells are not affected") {
    FunctionVolume<float> holes({21, 20, 19}, [](const Int3& p) {
        return noise(p, 3) < 0.01 ? std::numeric_limits<float>::quiet_NaN() : rough(p);
    });
    const Result r = surface(holes, 0.1);
    const MeshFaults faults = check_mesh(r.mesh, {0, 0, 0}, {20, 19, 18});
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.flat_triangles == 0);
    std::size_t expected = 0;
    for (std::int64_t i = 0; i < 20 * 19 * 18; ++i) {
        const Int3 low = Int3{20, 19, 18}.unlinear(i);
        unsigned below = 0;
        bool missing = false;
        for (unsigned corner = 0; corner < 8; ++corner) {
            const double u = holes.at(low + corner_offset(corner));
            below |= (u < 0.1 ? 1U : 0U) << corner;
            missing = missing || std::isnan(u);
        }
        expected += missing ? 0 : hexahedron_cases()[below].triangles;
    }
    CHECK(r.mesh.triangles.size() == expected);
}

TEST_CASE("a surface of hexahedral cells in a box has no crack where the box clips it") {
    FunctionVolume<float> volume({30, 28, 26}, rough);
    for (const WorldBox& box :
         {WorldBox{{3.3, 4.1, 2.7}, {21.2, 19.9, 22.5}}, WorldBox{{4, 5, 6}, {20, 21, 22}}}) {
        const Result r = surface(volume, 0.1, {}, box);
        const MeshFaults faults = check_mesh(r.mesh, box.lo, box.hi);
        CHECK(r.mesh.triangles.size() > 100);
        CHECK(faults.overused_edges == 0);
        CHECK(faults.misoriented_edges == 0);
        CHECK(faults.open_edges_inside == 0);
    }
}

TEST_CASE("a surface of hexahedral cells has the same bytes for any chunks, threads and memory") {
    FunctionVolume<std::uint8_t> volume({61, 47, 53}, [](const Int3& p) {
        const double value = 40 * (smooth(p) + 2.2) + 3 * noise(p);
        return static_cast<std::uint8_t>(std::min(value, 255.0));
    });
    for (const double iso : {90.0, 90.5}) {
        const Result r = surface(volume, iso, {16, 1});
        require_whole(r.mesh, {0, 0, 0}, {60, 46, 52});
        CHECK(r.bytes == surface(volume, iso, {8, 2}).bytes);
        CHECK(r.bytes == surface(volume, iso, {32, 2}).bytes);
        CHECK(r.bytes == surface(volume, iso, {8, 1, 24U << 20U}).bytes);
    }
}

TEST_CASE("hexahedral cells give about a third of the triangles of tetrahedra") {
    FunctionVolume<float> volume({40, 40, 40}, smooth_f);
    const Result hex = surface(volume, 0.2);
    const Result tet = surface(volume, 0.2, {}, {}, Cells::tetrahedra);
    const double share = static_cast<double>(hex.mesh.triangles.size()) /
                         static_cast<double>(tet.mesh.triangles.size());
    CHECK(share > 0.25);
    CHECK(share < 0.45);
}

TEST_CASE("hexahedral cells refuse what they do not support") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({9, 9, 9}, smooth_f);
    make_store(volume, folder / "s");
    const StoreReader store(folder / "s");
    const auto refused = [&](const auto& change) {
        SurfaceQuery query;
        query.grid.cells = Cells::hexahedra;
        REQUIRE_NOTHROW(extract_query(store, query, false));
        change(query);
        REQUIRE_THROWS_AS(extract_query(store, query, false), Error);
    };
    refused([](SurfaceQuery& q) {
        q.stop = ErrorBound{0.1};
        q.effort = Effort::none;
    });
    refused([](SurfaceQuery& q) {
        q.stop = DistanceBound{0.1};
        q.effort = Effort::none;
    });
    refused([](SurfaceQuery& q) { q.stop = ErrorBound{0.1, false, ErrorIndicator::estimate}; });
    refused([](SurfaceQuery& q) {
        q.stop = FieldThreshold{Field::hex_deviation, 0};
        q.stages.close = Outside::below;
    });
    refused([](SurfaceQuery& q) { q.grid.vertices = VertexPlace::exact; });
    refused([](SurfaceQuery& q) { q.focus.emplace(); });
    FunctionVolume<float> flat({9, 9, 1}, smooth_f);
    make_store(flat, folder / "f");
    const StoreReader plane(folder / "f");
    SurfaceQuery query;
    query.grid.cells = Cells::hexahedra;
    REQUIRE_THROWS_AS(extract_query(plane, query, false), Error);
}

TEST_CASE("at full resolution the default cells are hexahedra, unless an option needs tetrahedra") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({9, 9, 9}, smooth_f);
    make_store(volume, folder / "s");
    const StoreReader store(folder / "s");
    const auto cells = [&](const auto& change) {
        SurfaceQuery query;
        change(query);
        return extract_query(store, query, false).traversal.cells;
    };
    const DistanceBound distance{0.1};
    CHECK(cells([](SurfaceQuery& /*q*/) {}) == Cells::hexahedra);
    CHECK(cells([](SurfaceQuery& q) { q.grid.vertices = VertexPlace::exact; }) ==
          Cells::tetrahedra);
    CHECK(cells([](SurfaceQuery& q) {
              q.stop = ErrorBound{0.1};
              q.effort = Effort::none;
          }) == Cells::tetrahedra);
    CHECK(cells([&](SurfaceQuery& q) {
              q.stop = distance;
              q.effort = Effort::none;
          }) == Cells::tetrahedra);
    CHECK(cells([&](SurfaceQuery& q) { q.stop = distance; }) == Cells::hexahedra);
    CHECK(cells([&](SurfaceQuery& q) { q.stop = TriangleBudgetByDistance{100}; }) ==
          Cells::hexahedra);
    CHECK(cells([&](SurfaceQuery& q) {
              q.stop = distance;
              q.stages.components.emplace();
          }) == Cells::hexahedra);
    CHECK(cells([&](SurfaceQuery& q) {
              q.stop = distance;
              q.stages.close = Outside::below;
          }) == Cells::hexahedra);
    CHECK(cells([&](SurfaceQuery& q) {
              q.stop = distance;
              q.grid.bound = Field::deviation_bar;
          }) == Cells::tetrahedra);
    CHECK(cells([&](SurfaceQuery& q) {
              q.stop = distance;
              q.grid.cells = Cells::tetrahedra;
          }) == Cells::tetrahedra);
    FunctionVolume<float> flat({9, 9, 1}, smooth_f);
    make_store(flat, folder / "f");
    const StoreReader plane(folder / "f");
    SurfaceQuery query;
    query.stop = distance;
    CHECK(extract_query(plane, query, false).traversal.cells == Cells::tetrahedra);
}
