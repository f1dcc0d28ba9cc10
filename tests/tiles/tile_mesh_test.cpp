// The cubes of a tileset and the meshes of tiles: rounding, lines, and places on the globe.
#include "query/tiles/tile_mesh.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <set>

#include "query/tiles/coarser_tile.h"
#include "query/tiles/tileset_json.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

/// The highest level of cubes with a face at this coordinate; -1: none.
int level_of(std::int64_t steps, int top) {
    int level = -1;
    for (int k = 0; k <= top && steps % (std::int64_t{kTileSteps} << k) == 0; ++k) {
        level = k;
    }
    return level;
}

TileTriangle triangle(const std::array<std::array<std::uint16_t, 3>, 3>& at) {
    TileTriangle t;
    for (std::size_t k = 0; k < 3; ++k) {
        t.corners[k].at = at[k];
    }
    return t;
}

}  // namespace

TEST_CASE("the cubes contain the volume with a margin, and their faces are in planes of nodes") {
    std::mt19937 random(1);
    std::uniform_int_distribution<int> size(1, 3000);
    std::uniform_real_distribution<double> distance(0.1, 5);
    for (int i = 0; i < 300; ++i) {
        const Double3 spacing{distance(random), distance(random), distance(random)};
        const Double3 first{-0.5, -0.5, -0.5};
        const Double3 last{size(random) - 0.5, size(random) - 0.5, size(random) - 0.5};
        const TileGrid grid = TileGrid::over(spacing, first, last, 64);
        REQUIRE(grid.top <= TileGrid::kMaxTop);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double low = grid.origin[axis] / spacing[axis];
            const double high = low + std::ldexp(grid.edge[axis] / spacing[axis], grid.top);
            REQUIRE(low <= first[axis] - 0.5);
            REQUIRE(high >= last[axis] + 0.5);
            REQUIRE(low == Approx(std::round(low)));
            const double nodes = grid.edge[axis] / spacing[axis] / 2;
            REQUIRE(nodes == Approx(std::round(nodes)));
        }
    }
}

TEST_CASE("rounding is monotone, near, and fits all levels that have a face") {
    TileGrid grid;
    grid.edge = {1, 1, 1};
    grid.top = 5;
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> anywhere(0, 32);
    std::uniform_int_distribution<int> cube(0, 32);
    std::uniform_int_distribution<int> kind(0, 3);
    std::array<std::vector<std::array<double, 2>>, 3> seen;
    for (int i = 0; i < 20000; ++i) {
        Double3 p{};
        for (double& c : p) {
            const int near = kind(random);
            c = near == 0   ? cube(random)
                : near == 1 ? std::clamp(cube(random) + (anywhere(random) - 16) / 1e6, 0.0, 32.0)
                            : anywhere(random);
        }
        const auto at = grid.rounded(p);
        int level = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            level = std::max(level, level_of(at[axis], grid.top));
        }
        for (std::size_t axis = 0; axis < 3; ++axis) {
            REQUIRE(at[axis] % (std::int64_t{1} << level) == 0);
            REQUIRE(std::fabs(static_cast<double>(at[axis]) - p[axis] * kTileSteps) <=
                    std::ldexp(0.5, level) * (1 + 1e-12));
            // A point stays in its cube, and one in a face stays there.
            const double c = p[axis];
            REQUIRE(static_cast<double>(at[axis]) >= std::floor(c) * kTileSteps);
            REQUIRE(static_cast<double>(at[axis]) <= std::ceil(c) * kTileSteps);
        }
    }
}

TEST_CASE("numbers of cubes are places on the Z-curve, parents first") {
    for (std::uint32_t x = 0; x < 8; ++x) {
        for (std::uint32_t y = 0; y < 8; ++y) {
            for (std::uint32_t z = 0; z < 8; ++z) {
                const std::uint32_t number = cube_number({x, y, z});
                REQUIRE(cube_at(number) == std::array<std::uint32_t, 3>{x, y, z});
                REQUIRE(number / 8 == cube_number({x / 2, y / 2, z / 2}));
            }
        }
    }
}

TEST_CASE("the mesh of a tile does not depend on the order of its triangles") {
    std::mt19937 random(3);
    std::uniform_int_distribution<std::uint16_t> place(0, 9);
    std::vector<TileTriangle> triangles;
    for (int i = 0; i < 500; ++i) {
        std::array<std::array<std::uint16_t, 3>, 3> at{};
        for (auto& p : at) {
            p = {place(random), place(random), place(random)};
        }
        triangles.push_back(triangle(at));
        triangles.back().feature = static_cast<std::uint32_t>(i % 3);
    }
    const TileMesh mesh = tile_mesh(triangles);
    std::shuffle(triangles.begin(), triangles.end(), random);
    const TileMesh other = tile_mesh(triangles);
    REQUIRE(mesh.triangles == other.triangles);
    REQUIRE(mesh.vertices.size() == other.vertices.size());
    std::set<std::pair<Steps, std::uint32_t>> places;
    for (const TileMesh::Vertex& v : mesh.vertices) {
        REQUIRE(places.insert({v.at, v.feature}).second);
    }
}

TEST_CASE("a line is kept only where nothing else is left of the surface") {
    // A triangle, and one that collapsed to one of its edges.
    TileMesh mesh = tile_mesh(std::vector{triangle({{{0, 0, 0}, {9, 0, 0}, {0, 9, 0}}}),
                                          triangle({{{0, 0, 0}, {9, 0, 0}, {9, 0, 0}}})});
    REQUIRE(!widen_lines(mesh));
    REQUIRE(mesh.triangles.size() == 1);
    // A line and a point on their own, the point in the last corner of the cube.
    mesh = tile_mesh(std::vector{
        triangle({{{5, 5, 5}, {5, 5, 9}, {5, 5, 9}}}),
        triangle({{{5, 5, 9}, {5, 5, 5}, {5, 5, 5}}}),
        triangle({{{32768, 32768, 32768}, {32768, 32768, 32768}, {32768, 32768, 32768}}})});
    REQUIRE(widen_lines(mesh));
    REQUIRE(mesh.triangles.size() == 2);
    for (const PatchTriangle& t : mesh.triangles) {
        REQUIRE(mesh.has_places(t));
        for (const std::uint32_t v : t) {
            for (const std::int32_t c : mesh.vertices[v].at) {
                REQUIRE(c >= 0);
                REQUIRE(c <= kTileSteps);
            }
        }
    }
}

TEST_CASE("joined tiles keep the border of their cube, and stay within the limit") {
    // A plane across eight tiles, as a grid of squares.
    constexpr int kSquares = 16;
    constexpr std::int32_t kWidth = kTileSteps / kSquares;
    CoarserTile joined({1e-3, 1e-3, 1e-3}, 5);
    for (std::uint32_t x = 0; x < 2; ++x) {
        for (std::uint32_t y = 0; y < 2; ++y) {
            std::vector<TileTriangle> triangles;
            for (int i = 0; i < kSquares; ++i) {
                for (int j = 0; j < kSquares; ++j) {
                    const auto at = [](int a, int b) {
                        return std::array<std::uint16_t, 3>{static_cast<std::uint16_t>(a * kWidth),
                                                            static_cast<std::uint16_t>(b * kWidth),
                                                            1000};
                    };
                    triangles.push_back(triangle({at(i, j), at(i + 1, j), at(i + 1, j + 1)}));
                    triangles.push_back(triangle({at(i, j), at(i + 1, j + 1), at(i, j + 1)}));
                }
            }
            joined.add(tile_mesh(triangles), {x, y, 0});
        }
    }
    const SimplifiedTile result = joined.finish();
    REQUIRE(result.error <= 5);
    REQUIRE(result.mesh.triangles.size() < 2 * kSquares * kSquares);  // a quarter
    std::set<Steps> border;
    double area = 0;
    for (const PatchTriangle& t : result.mesh.triangles) {
        const Steps& a = result.mesh.vertices[t[0]].at;
        const Steps& b = result.mesh.vertices[t[1]].at;
        const Steps& c = result.mesh.vertices[t[2]].at;
        area += 0.5 * (static_cast<double>(b[0] - a[0]) * (c[1] - a[1]) -
                       static_cast<double>(b[1] - a[1]) * (c[0] - a[0]));
        for (const std::uint32_t v : t) {
            const Steps& at = result.mesh.vertices[v].at;
            if (at[0] == 0 || at[0] == kTileSteps || at[1] == 0 || at[1] == kTileSteps) {
                border.insert(at);
            }
        }
    }
    REQUIRE(border.size() == 8 * kSquares);
    REQUIRE(area == static_cast<double>(kTileSteps) * kTileSteps);
}

TEST_CASE("places on the globe are those of WGS 84") {
    // Source: the definition; the pole and two points on the equator.
    const Matrix4 pole = earth_matrix({0, 90, 0});
    CHECK(pole[14] == Approx(6356752.314245).epsilon(1e-12));
    CHECK(pole[12] == Approx(0).margin(1e-6));
    const Matrix4 gulf = earth_matrix({0, 0, 10});
    CHECK(gulf[12] == Approx(6378147.0).epsilon(1e-14));
    CHECK(gulf[1] == Approx(1));  // east is Y
    CHECK(gulf[6] == Approx(1));  // north is Z
    CHECK(gulf[8] == Approx(1));  // up is X
    const Matrix4 east = earth_matrix({90, 0, 0});
    CHECK(east[13] == Approx(6378137.0).epsilon(1e-14));
    CHECK(east[0] == Approx(-1));
}
