// Triangles without area are removed from a mesh or given an area: none remains, the topology is
// preserved, and vertices move at most as far as reported. Compared with slow implementations in
// this file.
#include "query/mesh/mend_triangles.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

#include <isonest/extract.h>

#include "query/simplify/proof/point_triangle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Point = std::array<float, 3>;
using Corners = std::array<std::uint32_t, 3>;

struct Triangles {
    std::vector<Point> positions;
    std::vector<Corners> corners;
};

/// Whether a * b and c * d are exactly equal, not only after rounding.
bool same_product(double a, double b, double c, double d) {
    const double p = a * b;
    const double q = c * d;
    return p == q && std::fma(a, b, -p) == std::fma(c, d, -q);
}

bool is_flat(const Triangles& mesh, const Corners& t) {
    std::array<std::array<double, 3>, 2> d{};
    for (std::size_t i = 0; i < 2; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            d[i][axis] = static_cast<double>(mesh.positions[t[i + 1]][axis]) -
                         static_cast<double>(mesh.positions[t[0]][axis]);
        }
    }
    return same_product(d[0][0], d[1][1], d[0][1], d[1][0]) &&
           same_product(d[0][1], d[1][2], d[0][2], d[1][1]) &&
           same_product(d[0][2], d[1][0], d[0][0], d[1][2]);
}

std::size_t flat_triangles(const Triangles& mesh) {
    return static_cast<std::size_t>(
        std::count_if(mesh.corners.begin(), mesh.corners.end(),
                      [&](const Corners& t) { return is_flat(mesh, t); }));
}

/// Invariants under homeomorphisms: the Euler characteristic and the number of borders of each
/// component. Fails if the mesh is not an oriented manifold.
std::multiset<std::pair<std::int64_t, std::size_t>> shape_of(const Triangles& mesh) {
    std::vector<std::uint32_t> parent(mesh.positions.size());
    for (std::uint32_t v = 0; v < parent.size(); ++v) {
        parent[v] = v;
    }
    const auto root = [&](std::uint32_t v) {
        while (parent[v] != v) {
            v = parent[v] = parent[parent[v]];
        }
        return v;
    };
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> sides;
    std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>> link(mesh.positions.size());
    std::set<std::uint32_t> used;
    for (const Corners& t : mesh.corners) {
        for (std::size_t i = 0; i < 3; ++i) {
            REQUIRE(t[i] != t[(i + 1) % 3]);
            REQUIRE(++sides[{t[i], t[(i + 1) % 3]}] == 1);
            parent[root(t[i])] = root(t[(i + 1) % 3]);
            link[t[i]].emplace_back(t[(i + 1) % 3], t[(i + 2) % 3]);
            used.insert(t[i]);
        }
    }
    REQUIRE(used.size() == mesh.positions.size());
    std::map<std::uint32_t, std::pair<std::int64_t, std::size_t>> shapes;
    std::map<std::uint32_t, std::uint32_t> border;  // in the opposite direction
    for (const auto& [side, count] : sides) {
        const auto [a, b] = side;
        const bool has_other = sides.count({b, a}) > 0;
        if (a < b || !has_other) {
            --shapes[root(a)].first;
        }
        if (!has_other) {
            REQUIRE(border.emplace(b, a).second);
        }
    }
    for (const std::uint32_t v : used) {
        ++shapes[root(v)].first;
        // One fan: as many steps around the vertex as it has triangles.
        std::map<std::uint32_t, std::uint32_t> next(link[v].begin(), link[v].end());
        std::uint32_t at = link[v].front().first;
        for (const auto& [from, to] : link[v]) {
            const bool begins =
                std::none_of(link[v].begin(), link[v].end(),
                             [f = from](const auto& other) { return other.second == f; });
            at = begins ? from : at;
        }
        const std::uint32_t first = at;
        std::size_t steps = 0;
        do {
            at = next.at(at);
            ++steps;
        } while (at != first && next.count(at) > 0);
        REQUIRE(steps == link[v].size());
    }
    for (const Corners& t : mesh.corners) {
        ++shapes[root(t[0])].first;
    }
    while (!border.empty()) {
        const std::uint32_t first = border.begin()->first;
        ++shapes[root(first)].second;
        for (auto at = border.begin(); at != border.end();) {
            const std::uint32_t to = at->second;
            border.erase(at);
            at = border.find(to);
        }
    }
    std::multiset<std::pair<std::int64_t, std::size_t>> all;
    for (const auto& [component, shape] : shapes) {
        all.insert(shape);
    }
    return all;
}

Double3 wide(const Point& p) {
    return {p[0], p[1], p[2]};
}

/// The maximum distance of the corners and centres of `from`'s triangles from `to`.
double distance_between(const Triangles& from, const Triangles& to) {
    double most = 0;
    for (const Corners& t : from.corners) {
        Double3 centre{};
        std::vector<Double3> points;
        for (const std::uint32_t v : t) {
            points.push_back(wide(from.positions[v]));
            for (std::size_t axis = 0; axis < 3; ++axis) {
                centre[axis] += points.back()[axis] / 3;
            }
        }
        points.push_back(centre);
        for (const Double3& p : points) {
            double least = std::numeric_limits<double>::infinity();
            for (const Corners& u : to.corners) {
                least = std::min(least, square_distance(p, Triangle{wide(to.positions[u[0]]),
                                                                    wide(to.positions[u[1]]),
                                                                    wide(to.positions[u[2]])}));
            }
            most = std::max(most, std::sqrt(least));
        }
    }
    return most;
}

struct Mended {
    Triangles mesh;
    MendedTriangles result;
};

Mended mended(const Triangles& before, double min_step = 0x1p-20) {
    const TemporaryFolder folder;
    ScratchMesh scratch(folder.path());
    MeshLayout layout;
    layout.vertices = before.positions.size();
    layout.elements = before.corners.size();
    layout.row_bytes = sizeof(float);  // its x, to check that rows stay with their vertices
    layout.attributes = {{"value", 1, false, 0}};
    constexpr float kMax = std::numeric_limits<float>::max();
    layout.lo = {kMax, kMax, kMax};
    layout.hi = {-kMax, -kMax, -kMax};
    std::vector<float> rows;
    for (const Point& p : before.positions) {
        rows.push_back(p[0]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], p[axis]);
            layout.hi[axis] = std::max(layout.hi[axis], p[axis]);
        }
    }
    std::vector<ElementCorners> corners;
    for (const Corners& t : before.corners) {
        corners.push_back({t[0], t[1], t[2]});
    }
    scratch.begin(layout);
    scratch.add_vertices({0, before.positions, std::as_bytes(std::span(rows)), sizeof(float)});
    scratch.add_elements({0, corners, {}, {}});
    scratch.end();
    Mended m;
    m.result =
        mend_triangles(scratch, {min_step, min_step, min_step}, folder.path(), silent_progress());
    CHECK(folder.names().empty());
    m.mesh.positions.assign(scratch.positions().begin(), scratch.positions().end());
    for (const ElementCorners t : scratch.corners()) {
        m.mesh.corners.push_back({static_cast<std::uint32_t>(t[0]),
                                  static_cast<std::uint32_t>(t[1]),
                                  static_cast<std::uint32_t>(t[2])});
    }
    for (std::size_t v = 0; v < m.mesh.positions.size(); ++v) {
        float x = 0;
        std::memcpy(&x, scratch.row(v).data(), sizeof(x));
        CHECK(std::fabs(static_cast<double>(x) - m.mesh.positions[v][0]) <= m.result.moved[0]);
    }
    return m;
}

double length_of(const Double3& a) {
    return std::hypot(a[0], a[1], a[2]);
}

/// Mends, and checks everything that is promised.
Mended require_mended(const Triangles& before) {
    CAPTURE(before.corners.size());
    const Mended m = mended(before);
    CHECK(m.result.found == flat_triangles(before));
    CHECK(m.result.left == 0);
    CHECK(flat_triangles(m.mesh) == 0);
    CHECK(shape_of(m.mesh) == shape_of(before));
    const double off = length_of(m.result.moved) + 1e-6;
    CHECK(distance_between(before, m.mesh) <= off);
    CHECK(distance_between(m.mesh, before) <= off);
    return m;
}

/// nx x ny squares of two triangles each.
Triangles grid(std::uint32_t nx, std::uint32_t ny,
               const std::function<Point(std::uint32_t, std::uint32_t)>& at) {
    Triangles mesh;
    for (std::uint32_t y = 0; y <= ny; ++y) {
        for (std::uint32_t x = 0; x <= nx; ++x) {
            mesh.positions.push_back(at(x, y));
        }
    }
    for (std::uint32_t y = 0; y < ny; ++y) {
        for (std::uint32_t x = 0; x < nx; ++x) {
            const std::uint32_t a = y * (nx + 1) + x;
            mesh.corners.push_back({a, a + 1, a + nx + 2});
            mesh.corners.push_back({a, a + nx + 2, a + nx + 1});
        }
    }
    return mesh;
}

Point flat_at(std::uint32_t x, std::uint32_t y) {
    return {static_cast<float>(x), static_cast<float>(y), 1};
}

/// A torus, or, if `open`, a tube, of n x n squares.
Triangles torus(std::uint32_t n, bool open, const std::function<Point(double, double)>& at) {
    Triangles mesh;
    const std::uint32_t rows = n + (open ? 1 : 0);
    for (std::uint32_t y = 0; y < rows; ++y) {
        for (std::uint32_t x = 0; x < n; ++x) {
            mesh.positions.push_back(at(2 * M_PI * x / n, 2 * M_PI * y / n));
        }
    }
    for (std::uint32_t y = 0; y < n; ++y) {
        for (std::uint32_t x = 0; x < n; ++x) {
            const auto v = [&](std::uint32_t i, std::uint32_t j) {
                return (y + j) % rows * n + (x + i) % n;
            };
            mesh.corners.push_back({v(0, 0), v(1, 0), v(1, 1)});
            mesh.corners.push_back({v(0, 0), v(1, 1), v(0, 1)});
        }
    }
    return mesh;
}

Triangles octahedron(const std::function<Point(const Point&)>& at) {
    Triangles mesh;
    for (const Point& p :
         {Point{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}) {
        mesh.positions.push_back(at(p));
    }
    for (const std::uint32_t x : {0U, 1U}) {
        for (const std::uint32_t y : {2U, 3U}) {
            for (const std::uint32_t z : {4U, 5U}) {
                const bool even = (x + y + z) % 2 == 0;
                mesh.corners.push_back(even ? Corners{x, y, z} : Corners{y, x, z});
            }
        }
    }
    return mesh;
}

}  // namespace

TEST_CASE("a mesh whose triangles all have an area is not changed") {
    const Triangles before = grid(7, 5, flat_at);
    const Mended m = require_mended(before);
    CHECK(m.mesh.positions == before.positions);
    CHECK(m.mesh.corners == before.corners);
    CHECK(m.result.moved_vertices == 0);
}

TEST_CASE("an edge of zero length is collapsed, inside and on the border") {
    for (const std::uint32_t y : {0U, 2U, 5U}) {
        const Triangles before = grid(6, 5, [&](std::uint32_t i, std::uint32_t j) {
            return flat_at(i == 3 && j == y ? 2 : i, j);
        });
        const Mended m = require_mended(before);
        CHECK(m.result.moved_vertices == 0);
        CHECK(m.mesh.positions.size() + 1 == before.positions.size());
        CHECK(m.mesh.corners.size() + (y == 2 ? 2 : 1) == before.corners.size());
    }
}

TEST_CASE("a triangle that is a segment is flipped, or dropped if its longest side is a border") {
    // The corners 0, 1 and 2 are on a line.
    Triangles inside{{{0, 0, 0}, {2, 0, 0}, {1, 0, 0}, {1, 2, 0}, {1, -2, 0}},
                     {{0, 1, 2}, {1, 0, 4}, {1, 3, 2}, {3, 0, 2}}};
    const Mended flipped = require_mended(inside);
    CHECK(flipped.mesh.corners.size() == 4);
    CHECK(flipped.result.moved_vertices == 0);
    inside.corners.erase(inside.corners.begin() + 1);
    inside.positions.pop_back();
    const Mended dropped = require_mended(inside);
    CHECK(dropped.mesh.corners.size() == 2);
    CHECK(dropped.result.moved_vertices == 0);
}

TEST_CASE("a side is not flipped into an existing edge") {
    // Vertex 1 is surrounded by three triangles; 0 lies between 1 and 2, and shares an edge with 3.
    const Mended m = require_mended(
        Triangles{{{1, 0, 0}, {0, 0, 0}, {2, 0, 0}, {1, 2, 0}}, {{0, 1, 2}, {2, 1, 3}, {1, 0, 3}}});
    CHECK(m.mesh.corners.size() == 3);
    CHECK(m.result.moved_vertices == 1);
}

TEST_CASE("a closed component in a single point, or on a segment, gets a volume and stays closed") {
    for (const float origin : {0.0F, 1.0F, -3e6F}) {
        for (const float stretch : {0.0F, 4.0F}) {
            const Triangles before = octahedron([&](const Point& p) {
                return Point{origin + stretch * p[0], origin, origin};
            });
            const Mended m = require_mended(before);
            CHECK(m.result.moved_vertices > 0);
            CHECK(m.result.moved_vertices <= m.mesh.positions.size());
        }
    }
}

TEST_CASE("a component that has shrunk to a point keeps its holes") {
    require_mended(torus(9, false, [](double, double) { return Point{5, 6, 7}; }));
    require_mended(torus(9, true, [](double, double) { return Point{5, 6, 7}; }));
    require_mended(grid(1, 1, [](std::uint32_t, std::uint32_t) { return Point{5, 6, 7}; }));
    require_mended(Triangles{{{1, 1, 1}, {2, 1, 1}, {3, 1, 1}}, {{0, 1, 2}}});
}

TEST_CASE("a neck of zero width stays a neck") {
    require_mended(torus(8, true, [](double around, double along) {
        const double r = std::fabs(along - M_PI) < 0.5 ? 0 : 1;
        return Point{static_cast<float>(r * std::cos(around)),
                     static_cast<float>(r * std::sin(around)), static_cast<float>(along)};
    }));
}

TEST_CASE("large clusters of vertices at one position, or on one line, are mended") {
    const auto in = [](std::uint32_t i) { return i > 5 && i < 30; };
    const auto to_point = [&](std::uint32_t x, std::uint32_t y) {
        return in(x) && in(y) ? flat_at(17, 17) : flat_at(x, y);
    };
    const auto to_line = [&](std::uint32_t x, std::uint32_t y) {
        return in(x) && in(y) ? flat_at(x, 17) : flat_at(x, y);
    };
    const auto to_dots = [&](std::uint32_t x, std::uint32_t y) {
        return flat_at(x / 4 * 4, y / 4 * 4);
    };
    for (const auto& at : std::vector<std::function<Point(std::uint32_t, std::uint32_t)>>{
             to_point, to_line, to_dots}) {
        const Triangles before = grid(36, 36, at);
        REQUIRE(flat_triangles(before) > 500);
        require_mended(before);
    }
}

TEST_CASE("a hundred thousand triangles at one position are mended quickly") {
    const Triangles before = grid(230, 230, [](std::uint32_t, std::uint32_t) {
        return Point{1, 2, 3};
    });
    const Mended m = mended(before);
    CHECK(m.result.found == before.corners.size());
    CHECK(m.result.left == 0);
    CHECK(flat_triangles(m.mesh) == 0);
    CHECK(shape_of(m.mesh) == shape_of(before));
}

TEST_CASE("a vertex where two sheets touch still joins them after mending") {
    // Two triangles with one common corner, and on each side one more without area.
    const Triangles before{{{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {-2, 0, 0}, {0, -2, 0}, {1, 0, 0}},
                           {{0, 1, 2}, {0, 3, 4}, {1, 0, 5}}};
    const Mended m = mended(before);
    CHECK(m.result.left == 0);
    CHECK(flat_triangles(m.mesh) == 0);
    CHECK(m.mesh.corners == std::vector<Corners>{{0, 5, 2}, {0, 3, 4}, {1, 2, 5}});
}

namespace {

/// A volume with another origin.
template <class T>
class PlacedVolume : public FunctionVolume<T> {
  public:
    PlacedVolume(const Int3& n, const std::function<T(const Int3&)>& f, const Double3& origin)
        : FunctionVolume<T>(n, f), origin_(origin) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription d = FunctionVolume<T>::describe();
        d.origin = origin_;
        return d;
    }

  private:
    Double3 origin_;
};

struct Surface {
    Triangles mesh;
    ExtractReport report;
};

template <class T>
Surface surface_of(const Int3& n, const std::function<T(const Int3&)>& f, const Double3& origin,
                   SurfaceQuery query, int threads = 2, std::uint64_t memory = 1U << 30U,
                   int chunk = 8) {
    const TemporaryFolder folder;
    PlacedVolume<T> volume(n, f, origin);
    make_store(volume, folder / "s", with_chunk(chunk));
    const Store store(folder / "s");
    if (query.box) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            query.box->lo[axis] += origin[axis];
            query.box->hi[axis] += origin[axis];
        }
    }
    MeshCollector mesh;
    Surface s;
    s.report = extract(store, query, mesh, {memory, threads, folder.path()});
    CHECK(folder.names().size() == 1);
    CHECK(s.report.triangles == mesh.triangles.size());
    CHECK(s.report.vertices == mesh.vertices.size());
    s.mesh = {mesh.vertices, mesh.triangles};
    return s;
}

/// The mesh relative to the origin, so that the two can be compared.
Triangles moved_back(Triangles mesh, const Double3& origin) {
    for (Point& p : mesh.positions) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            p[axis] = static_cast<float>(static_cast<double>(p[axis]) - origin[axis]);
        }
    }
    return mesh;
}

template <class T>
void require_mended_remotely(const std::function<T(const Int3&)>& f, double iso, double origin,
                             const std::optional<WorldBox>& box) {
    const Int3 n{12, 11, 13};
    SurfaceQuery query;
    query.iso = iso;
    query.box = box;
    const Surface near = surface_of<T>(n, f, {0, 0, 0}, query);
    const Double3 place{origin, -origin, origin};
    const Surface far = surface_of<T>(n, f, place, query);
    CAPTURE(iso, origin, near.mesh.corners.size(), far.report.mending.mended);
    CHECK(near.report.mending.zero_area == 0);
    CHECK(far.report.mending.zero_area == 0);
    CHECK(flat_triangles(near.mesh) == 0);
    CHECK(flat_triangles(far.mesh) == 0);
    CHECK(shape_of(far.mesh) == shape_of(near.mesh));
    const double off = std::sqrt(3.0) * (far.report.coordinate_rounding + 1e-5);
    const Triangles back = moved_back(far.mesh, place);
    CHECK(distance_between(back, near.mesh) <= off);
    CHECK(distance_between(near.mesh, back) <= off);
}

}  // namespace

TEST_CASE(
    "surfaces of volumes far from the origin have no triangle without area, and the shape of near "
    "ones") {
    std::uint64_t mended_in_all = 0;
    std::int64_t seed = 0;
    for (const double origin : {4000.3, 150000.7, 1000000.6, 3000000.5}) {
        for (int i = 0; i < 3; ++i) {
            ++seed;
            const auto r = [&](std::int64_t k) { return noise({seed, k, 3}); };
            std::optional<WorldBox> box;
            if (i > 0) {
                box = WorldBox{{3 * r(1), 3 * r(2), 3 * r(3)},
                               {8 + 3 * r(4), 7 + 3 * r(5), 9 + 3 * r(6)}};
            }
            require_mended_remotely<float>(
                [&](const Int3& p) {
                    return static_cast<float>(smooth(p) + 0.8 * noise(p, 77 + seed));
                },
                0.3, origin, box);
            require_mended_remotely<std::uint8_t>(
                [&](const Int3& p) {
                    return static_cast<std::uint8_t>(3 * noise(p, 99 + seed) + 3 * r(7) +
                                                     2 * smooth(p));
                },
                3, origin, box);
        }
        SurfaceQuery query;
        query.iso = 0.3;
        mended_in_all +=
            surface_of<float>(
                {12, 11, 13}, [](const Int3& p) { return static_cast<float>(noise(p)); },
                {origin, origin, origin}, query)
                .report.mending.mended;
    }
    CHECK(mended_in_all > 100);
}

TEST_CASE("the mended mesh is the same for any threads, memory and chunks") {
    const auto f = [](const Int3& p) { return static_cast<float>(noise(p)); };
    SurfaceQuery query;
    query.iso = 0.4;
    query.attributes.normals = true;
    const Int3 n{40, 35, 37};
    const Double3 origin{700000.3, 700000.3, -1400000.1};
    const Surface first = surface_of<float>(n, f, origin, query, 1);
    REQUIRE(first.report.mending.mended > 1000);
    for (const int threads : {1, 2, 4}) {
        for (const int chunk : {8, 32}) {
            for (const std::uint64_t memory : {1U << 30U, 48U << 20U}) {
                const Surface s = surface_of<float>(n, f, origin, query, threads, memory, chunk);
                CHECK(s.mesh.positions == first.mesh.positions);
                CHECK(s.mesh.corners == first.mesh.corners);
                CHECK(s.report.mending.mended == first.report.mending.mended);
                CHECK(s.report.coordinate_rounding == first.report.coordinate_rounding);
            }
        }
    }
}

TEST_CASE("a mesh is mended before components are chosen and it is simplified") {
    const auto f = [](const Int3& p) { return static_cast<float>(smooth(p) + 0.4 * noise(p)); };
    SurfaceQuery query;
    query.iso = 0.3;
    query.grid.cells = GENERATE(Cells::tetrahedra, Cells::hexahedra);
    const Int3 n{40, 35, 37};
    const Double3 origin{100000.3, 100000.3, -100000.1};
    const Surface all = surface_of<float>(n, f, origin, query);
    REQUIRE(all.report.mending.mended > 0);
    query.stages.components = ComponentChoice{.largest = 1};
    const Surface largest = surface_of<float>(n, f, origin, query);
    CHECK(largest.report.components->components == shape_of(all.mesh).size());
    CHECK(largest.report.triangles + largest.report.components->dropped_triangles ==
          all.report.triangles);
    CHECK(shape_of(largest.mesh).size() == 1);
    query.stop = DistanceBound{0.5, true};
    const Surface simplified = surface_of<float>(n, f, origin, query);
    CHECK(simplified.report.mending.mended == all.report.mending.mended);
    CHECK(simplified.report.distance->full_triangles == all.report.triangles);
    CHECK(simplified.report.mending.zero_area == 0);
    CHECK(flat_triangles(simplified.mesh) == 0);
    CHECK(shape_of(simplified.mesh) == shape_of(largest.mesh));
}
