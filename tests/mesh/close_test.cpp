// Closed surfaces: watertight, and their volume is that of the solid in all tetrahedra, each
// clipped separately, or that of the hexahedra's surface in a volume with an additional layer of
// nodes.
#include <catch2/catch.hpp>
#include <cstdint>
#include <functional>
#include <map>
#include <random>
#include <set>

#include <isonest/error.h>

#include "query/traverse/each_leaf.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Double3 kFar{1e9, 1e9, 1e9};
constexpr int kRounds = 100;  // number of random volumes
using Corners = std::array<Double3, 4>;

double at(const Double3& p, const Double3& q, double t, std::size_t i) {
    return p[i] + t * (q[i] - p[i]);
}

double volume_of(const Corners& v) {
    std::array<Double3, 3> d;
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            d[i][axis] = v[i + 1][axis] - v[0][axis];
        }
    }
    return std::fabs(d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) -
                     d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                     d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0])) /
           6;
}

/// Clips a tetrahedron, and what remains of it, at linear functions, keeping the part where each is
/// >= 0. `functions`: their values at the corners. Returns the volume.
double volume_within(const Corners& v, std::vector<std::array<double, 4>> functions) {
    if (functions.empty()) {
        return volume_of(v);
    }
    const std::array<double, 4> f = functions.back();
    std::vector<std::size_t> in;
    std::vector<std::size_t> out;
    for (std::size_t i = 0; i < 4; ++i) {
        (f[i] >= 0 ? in : out).push_back(i);
    }
    if (in.empty()) {
        return 0;
    }
    functions.pop_back();
    if (out.empty()) {
        return volume_within(v, functions);
    }
    struct Point {
        Double3 p;
        std::vector<double> values;
    };
    const auto corner = [&](std::size_t i) {
        Point point{v[i], {}};
        for (const auto& g : functions) {
            point.values.push_back(g[i]);
        }
        return point;
    };
    const auto between = [&](std::size_t a, std::size_t b) {
        const double t = f[a] / (f[a] - f[b]);
        Point point;
        for (std::size_t i = 0; i < 3; ++i) {
            point.p[i] = at(v[a], v[b], t, i);
        }
        for (const auto& g : functions) {
            point.values.push_back(g[a] + t * (g[b] - g[a]));
        }
        return point;
    };
    const auto piece = [&](const std::array<Point, 4>& points) {
        Corners corners;
        std::vector<std::array<double, 4>> values(functions.size());
        for (std::size_t i = 0; i < 4; ++i) {
            corners[i] = points[i].p;
            for (std::size_t g = 0; g < values.size(); ++g) {
                values[g][i] = points[i].values[g];
            }
        }
        return volume_within(corners, values);
    };
    // Prisms are divided into three tetrahedra.
    const auto prism = [&](const std::array<Point, 3>& a, const std::array<Point, 3>& b) {
        return piece({a[0], a[1], a[2], b[0]}) + piece({a[1], a[2], b[0], b[1]}) +
               piece({a[2], b[0], b[1], b[2]});
    };
    if (in.size() == 1) {
        return piece({corner(in[0]), between(in[0], out[0]), between(in[0], out[1]),
                      between(in[0], out[2])});
    }
    if (in.size() == 2) {
        return prism({corner(in[0]), between(in[0], out[0]), between(in[0], out[1])},
                     {corner(in[1]), between(in[1], out[0]), between(in[1], out[1])});
    }
    return prism({corner(in[0]), corner(in[1]), corner(in[2])},
                 {between(in[0], out[0]), between(in[1], out[0]), between(in[2], out[0])});
}

/// Volume of the part of the box that is not below the isovalue (or is below it), in cubes of the
/// node distance.
double solid_volume(const StoreReader& store, double iso, double error, const ClipBox& box,
                    Outside outside) {
    ChunkCache cache(store, 1U << 22U);
    double sum = 0;
    const StopsBelow stop{Tolerance{error, {}, {}, {}, {}}, Field::deviation_bar};
    for_each_leaf<3>(
        cache, stop, volume_box(store.layout().lattice()),
        [&](std::uint64_t, std::span<const DomainLeaf<3>> leaves) {
            for (const DomainLeaf<3>& leaf : leaves) {
                Corners corners{};
                std::vector<std::array<double, 4>> functions(6);
                std::array<double, 4> above{};
                bool complete = true;
                for (std::size_t i = 0; i < 4; ++i) {
                    const double d = leaf.element.value[i] - iso;
                    complete = complete && std::isfinite(d);
                    above[i] = d;
                    for (std::size_t axis = 0; axis < 3; ++axis) {
                        const auto x =
                            static_cast<double>(leaf.element.v[i][static_cast<int>(axis)]);
                        corners[i][axis] = x;
                        functions[2 * axis][i] = x - box.lo[axis];
                        functions[2 * axis + 1][i] = box.hi[axis] - x;
                    }
                }
                if (!complete) {
                    continue;
                }
                const double whole = volume_within(corners, functions);
                functions.push_back(above);
                const double not_below = volume_within(corners, functions);
                sum += outside == Outside::below ? not_below : whole - not_below;
            }
        },
        1, silent_progress());
    return sum;
}

struct Closed {
    Mesh mesh;
    std::string bytes;
    ExtractReport report;
};

struct Settings {
    double error = 0;
    std::optional<WorldBox> box;
    Outside outside = Outside::below;
    int threads = 2;
    std::uint64_t memory = 1U << 30U;
    bool normals = false;
    Cells cells = Cells::tetrahedra;
};

Closed closed(const StoreReader& store, double iso, const Settings& with) {
    const TemporaryFolder folder;
    Extraction e;
    e.iso = iso;
    e.error = with.error;
    e.box = with.box;
    e.close = with.outside;
    e.threads = with.threads;
    e.memory = with.memory;
    e.normals = with.normals;
    e.cells = with.cells;
    Closed r;
    r.report = extract(store, folder / "m.ply", e, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    CHECK(r.mesh.triangles.size() == r.report.triangles);
    return r;
}

/// In world units; positive if the triangles face outward.
double enclosed(const Mesh& mesh) {
    double sum = 0;
    for (const auto& t : mesh.triangles) {
        std::array<Double3, 3> p;
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                p[i][axis] = static_cast<double>(mesh.vertices[t[i]][axis]);
            }
        }
        sum += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) -
               p[0][1] * (p[1][0] * p[2][2] - p[1][2] * p[2][0]) +
               p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    return sum / 6;
}

void require_watertight(const Mesh& mesh) {
    const MeshFaults faults = check_mesh(mesh, {-1e9, -1e9, -1e9}, kFar);
    CHECK(faults.unused_vertices == 0);
    CHECK(faults.overused_edges == 0);
    CHECK(faults.misoriented_edges == 0);
    CHECK(faults.open_edges_inside == 0);
    CHECK(faults.split_vertices == 0);
    for (const auto& t : mesh.triangles) {
        CHECK((t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    }
}

ClipBox lattice_box(const StoreReader& store, const std::optional<WorldBox>& box) {
    ClipBox clip = volume_box(store.layout().lattice());
    for (std::size_t axis = 0; box && axis < 3; ++axis) {
        const double spacing = store.layout().header().spacing[axis];
        clip.lo[axis] = std::max(clip.lo[axis], box->lo[axis] / spacing);
        clip.hi[axis] = std::min(clip.hi[axis], box->hi[axis] / spacing);
    }
    return clip;
}

/// Positions of the lattice's nodes within a box and of the box's faces.
std::vector<double> planes_within(double lo, double hi) {
    std::vector<double> planes{lo};
    for (auto x = static_cast<std::int64_t>(std::floor(lo)) + 1; static_cast<double>(x) < hi; ++x) {
        planes.push_back(static_cast<double>(x));
    }
    planes.push_back(hi);
    return planes;
}

/// solid_volume() for hexahedra at full resolution: the trilinear function sampled at the planes of
/// the box, with a surrounding layer of nodes whose values are far outside, has a surface without a
/// border. Each axis is then stretched so that the planes are in their places.
template <class T>
double solid_volume_of_cells(const FunctionVolume<T>& volume, double iso, const ClipBox& box,
                             Outside outside) {
    std::array<std::vector<double>, 3> planes;
    Int3 n;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        planes[a] = planes_within(box.lo[a], box.hi[a]);
        planes[a].insert(planes[a].begin(), planes[a].front());
        planes[a].push_back(planes[a].back());
        n[axis] = static_cast<std::int64_t>(planes[a].size());
    }
    FunctionVolume<double> padded(n, [&](const Int3& p) {
        if (p.x == 0 || p.y == 0 || p.z == 0 || p.x == n.x - 1 || p.y == n.y - 1 ||
            p.z == n.z - 1) {
            return outside == Outside::below ? -1e200 : 1e200;
        }
        Int3 low;
        Double3 t{};
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const double x = planes[a][static_cast<std::size_t>(p[axis])];
            low[axis] = static_cast<std::int64_t>(std::floor(x));
            t[a] = x - std::floor(x);
        }
        const auto along = [&](auto&& self, int axis, const Int3& at) -> double {
            if (axis < 0) {
                return volume.at(at);
            }
            Int3 next = at;
            ++next[axis];
            const double u = self(self, axis - 1, at);
            const double s = t[static_cast<std::size_t>(axis)];
            return s == 0 ? u : u + s * (self(self, axis - 1, next) - u);
        };
        return along(along, 2, low);
    });
    const TemporaryFolder folder;
    make_store(padded, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    Extraction e;
    // Values equal to the isovalue count as larger at the faces of the box.
    e.iso = std::nextafter(iso, -std::numeric_limits<double>::infinity());
    e.cells = Cells::hexahedra;
    extract(store, folder / "m.ply", e, silent_progress());
    Mesh mesh = read_mesh(folder / "m.ply");
    for (auto& vertex : mesh.vertices) {
        for (std::size_t a = 0; a < 3; ++a) {
            const auto x = static_cast<double>(vertex[a]);
            const auto i = static_cast<std::size_t>(std::floor(x));
            const double from = planes[a][i];
            const double to = planes[a][std::min(i + 1, planes[a].size() - 1)];
            vertex[a] = static_cast<float>(from + (x - std::floor(x)) * (to - from));
        }
    }
    return enclosed(mesh);
}

template <class T>
double trilinear_value(const FunctionVolume<T>& volume, const Double3& p) {
    double sum = 0;
    for (std::int64_t corner = 0; corner < 8; ++corner) {
        double weight = 1;
        Int3 node;
        for (int axis = 0; axis < 3; ++axis) {
            const double x = p[static_cast<std::size_t>(axis)];
            const bool high = (corner >> axis & 1) != 0;
            weight *= high ? x - std::floor(x) : 1 - (x - std::floor(x));
            node[axis] = static_cast<std::int64_t>(std::floor(x)) + (high ? 1 : 0);
        }
        sum += weight * volume.at(node);
    }
    return sum;
}

/// Number of nodes at the isovalue with a vertex of their own: polygons there have other diagonals.
template <class T>
std::size_t hits_within(const FunctionVolume<T>& volume, double iso, const ClipBox& box) {
    std::size_t hits = 0;
    for (std::int64_t i = 0; i < volume.nodes().product(); ++i) {
        const Int3 p = volume.nodes().unlinear(i);
        bool is_inside = volume.at(p) == iso;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const auto x = static_cast<double>(p[axis]);
            is_inside = is_inside && x - 1 > box.lo[a] && x + 1 < box.hi[a];
        }
        hits += is_inside ? 1 : 0;
    }
    return hits;
}

/// Checks the volumes on both sides of the isovalue and their sum; tetrahedra give about the same.
template <class T>
void require_solid_of_cells(const FunctionVolume<T>& volume, const StoreReader& store, double iso,
                            const std::optional<WorldBox>& world) {
    const ClipBox box = lattice_box(store, world);
    const Double3& spacing = store.layout().header().spacing;
    const double cell = spacing[0] * spacing[1] * spacing[2];
    double all = cell;
    double surroundings = cell;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        all *= box.hi[axis] - box.lo[axis];
        // Coordinates are rounded to float32.
        surroundings *= box.hi[axis] - box.lo[axis] + 0.1;
    }
    const auto hits = static_cast<double>(hits_within(volume, iso, box));
    double sum = 0;
    double moved = 0;  // number of vertices moved, each by up to 4 steps of 2^-16
    for (const Outside outside : {Outside::below, Outside::above}) {
        Settings with{0, world, outside};
        with.cells = Cells::hexahedra;
        const Closed r = closed(store, iso, with);
        require_watertight(r.mesh);
        const double found = enclosed(r.mesh);
        // Where triangles were mended, polygons have other diagonals as well.
        const double diagonals =
            cell * (hits + 0.05 * static_cast<double>(r.report.mending.mended));
        CAPTURE(static_cast<int>(outside), hits, r.report.mending.mended);
        CHECK(found == Approx(cell * solid_volume_of_cells(volume, iso, box, outside))
                           .margin(1e-5 * surroundings + diagonals));
        CHECK((outside == Outside::below ? found : -found) > -1e-5 * surroundings);
        sum += std::fabs(found);
        moved += static_cast<double>(r.report.apart.moved);
    }
    CHECK(sum == Approx(all).margin(1e-5 * surroundings + 1e-4 * cell * moved));
}

void require_solid(const StoreReader& store, double iso, const Settings& with) {
    const Closed r = closed(store, iso, with);
    require_watertight(r.mesh);
    const ClipBox box = lattice_box(store, with.box);
    const Double3& spacing = store.layout().header().spacing;
    const double cell = spacing[0] * spacing[1] * spacing[2];
    const double expected = cell * solid_volume(store, iso, with.error, box, with.outside);
    const double sign = with.outside == Outside::below ? 1 : -1;
    double all = cell;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // Coordinates are rounded to float32.
        all *= box.hi[axis] - box.lo[axis] + 0.1;
    }
    // Sheets that touch are moved apart.
    const double moved = r.report.coordinate_rounding *
                         std::max({spacing[0], spacing[1], spacing[2]}) * r.report.measures->area;
    CHECK(sign * enclosed(r.mesh) == Approx(expected).margin(1e-5 * all + moved));
}

std::vector<std::optional<WorldBox>> boxes_in(const Int3& n, const Double3& spacing) {
    std::vector<std::optional<WorldBox>> boxes{std::nullopt};
    const auto part = [&](double from, double to, double round) {
        WorldBox box;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto last = static_cast<double>(n[static_cast<int>(axis)] - 1);
            const double lo = round > 0 ? std::floor(from * last / round) * round : from * last;
            const double hi = round > 0 ? std::ceil(to * last / round) * round : to * last;
            box.lo[axis] = spacing[axis] * lo;
            box.hi[axis] = spacing[axis] * hi;
        }
        boxes.emplace_back(box);
    };
    part(0.2, 0.8, 1);
    part(0.2, 0.8, 0.5);
    part(0.13, 0.71, 0);
    part(0.41, 0.47, 0);
    return boxes;
}

float smooth_f(const Int3& p) {
    return static_cast<float>(smooth(p));
}
std::uint8_t few_levels(const Int3& p) {
    return static_cast<std::uint8_t>(4 * noise(p));
}

template <class T>
void require_solids(const Int3& n, const std::function<T(const Int3&)>& f,
                    const std::vector<double>& isovalues, const std::vector<double>& errors,
                    const Double3& spacing = {1, 1, 1}) {
    FunctionVolume<T> volume(n, f);
    volume.spacing_ = spacing;
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    for (const double iso : isovalues) {
        std::size_t of_cells = 0;
        for (const auto& box : boxes_in(n, spacing)) {
            CAPTURE(n.x, n.y, n.z, iso, of_cells++);
            require_solid_of_cells(volume, store, iso, box);
        }
        for (const double error : errors) {
            for (const Outside outside : {Outside::below, Outside::above}) {
                std::size_t number = 0;
                for (const auto& box : boxes_in(n, spacing)) {
                    CAPTURE(n.x, n.y, n.z, iso, error, static_cast<int>(outside), number++);
                    require_solid(store, iso, {error, box, outside});
                }
            }
        }
    }
}

}  // namespace

TEST_CASE("a closed surface is watertight and encloses the volume of the solid in the cells") {
    for (const Int3& n : {Int3{2, 2, 2}, Int3{5, 4, 7}, Int3{17, 17, 17}, Int3{3, 20, 6}}) {
        require_solids<float>(n, smooth_f, {-0.4, 0.1, 0.6}, {0, 0.02, 0.3, 2});
    }
    require_solids<float>({20, 31, 18}, smooth_f, {0.1}, {0, 0.05});
    require_solids<float>({9, 7, 6}, smooth_f, {0.1}, {0, 0.2}, {1, 1, 10});
}

TEST_CASE("a surface of noise is closed at every tolerance") {
    const auto f = [](const Int3& p) { return static_cast<float>(noise(p)); };
    for (const Int3& n : {Int3{5, 4, 7}, Int3{14, 11, 9}}) {
        require_solids<float>(n, f, {0.3, 0.9}, {0, 0.1, 0.4, 0.8});
    }
}

TEST_CASE("a surface through nodes at the isovalue is closed as well") {
    for (const Int3& n : {Int3{2, 2, 2}, Int3{5, 4, 7}, Int3{11, 9, 12}}) {
        require_solids<std::uint8_t>(n, few_levels, {1, 2, 3}, {0, 1.5});
        require_solids<std::uint8_t>(
            n, [](const Int3& p) { return static_cast<std::uint8_t>((p.x + p.y + p.z) & 1); },
            {0, 0.5, 1}, {0, 0.6, 2});
        require_solids<std::uint8_t>(
            n, [](const Int3& p) { return static_cast<std::uint8_t>(p.z / 2); }, {1, 2}, {0, 0.6});
    }
    // Large enough to have nodes that no leaf at a face contains.
    require_solids<std::uint8_t>({35, 26, 37}, few_levels, {2}, {0, 2.5});
    require_solids<std::uint8_t>(
        {35, 26, 37}, [](const Int3& p) { return static_cast<std::uint8_t>(9 + 4 * smooth(p)); },
        {9}, {0, 1, 3});
}

TEST_CASE("surfaces of values very close to the isovalue are closed") {
    // So close that a crossing is rounded to the node.
    const auto f = [](const Int3& p) {
        const double u = noise(p);
        return u < 0.3 ? 1e-30 : u < 0.6 ? -1e-30 : u < 0.8 ? 1.0 : -1.0;
    };
    require_solids<double>({7, 8, 6}, f, {0}, {0, 0.5, 3});
}

TEST_CASE("the closed surface of a constant volume is the box or empty") {
    FunctionVolume<std::uint8_t> volume({6, 5, 9}, [](const Int3&) { return std::uint8_t{7}; });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {1.0, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const double iso : {6.5, 7.0, 7.5}) {
            CAPTURE(error, iso);
            Settings with{error, {}, Outside::above};
            with.cells = cells;
            const Closed above = closed(store, iso, with);
            with.outside = Outside::below;
            const Closed below = closed(store, iso, with);
            const bool full = iso <= 7;
            CHECK(below.mesh.triangles.empty() == !full);
            CHECK(above.mesh.triangles.empty() == full);
            const Mesh& mesh = full ? below.mesh : above.mesh;
            require_watertight(mesh);
            CHECK(enclosed(mesh) == Approx(full ? 5 * 4 * 8 : -5 * 4 * 8));
            CHECK(below.report.mending.zero_area + above.report.mending.zero_area == 0);
            if (error == 0) {
                // Two triangles for each face of a cell, and nothing else.
                CHECK(mesh.triangles.size() == 4 * (5 * 4 + 4 * 8 + 8 * 5));
                CHECK(mesh.vertices.size() == 6 * 5 * 9 - 4 * 3 * 7);
            }
        }
    }
}

TEST_CASE("caps are in the faces and face outward") {
    FunctionVolume<float> volume({17, 18, 17}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    const WorldBox box{{2, 3.25, 1.5}, {12.75, 14, 40}};
    const Double3 hi{12.75, 14, 16};
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {0.2, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const Outside outside : {Outside::below, Outside::above}) {
            Settings with{error, box, outside};
            with.cells = cells;
            const Mesh mesh = closed(store, 0.1, with).mesh;
            std::array<int, 6> caps{};
            for (const auto& t : mesh.triangles) {
                std::array<Double3, 3> p;
                for (std::size_t i = 0; i < 3; ++i) {
                    for (std::size_t a = 0; a < 3; ++a) {
                        p[i][a] = static_cast<double>(mesh.vertices[t[i]][a]);
                        CHECK((p[i][a] >= box.lo[a] && p[i][a] <= hi[a]));
                    }
                }
                for (std::size_t a = 0; a < 3; ++a) {
                    const auto in_plane = [&](double x) {
                        return p[0][a] == x && p[1][a] == x && p[2][a] == x;
                    };
                    const std::size_t b = (a + 1) % 3;
                    const std::size_t c = (a + 2) % 3;
                    const double n = (p[1][b] - p[0][b]) * (p[2][c] - p[0][c]) -
                                     (p[1][c] - p[0][c]) * (p[2][b] - p[0][b]);
                    const double out = outside == Outside::below ? n : -n;
                    if (in_plane(box.lo[a])) {
                        ++caps[2 * a];
                        CHECK(out <= 0);
                    } else if (in_plane(hi[a])) {
                        ++caps[2 * a + 1];
                        CHECK(out >= 0);
                    }
                }
            }
            for (const int count : caps) {
                CAPTURE(caps, error, static_cast<int>(outside));
                CHECK(count > 0);
            }
        }
    }
}

TEST_CASE("surfaces are closed for random volumes, isovalues, tolerances and boxes") {
    std::mt19937_64 random(20);
    const auto below = [&](std::int64_t n) {
        return static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(n));
    };
    const auto fraction = [&] { return static_cast<double>(random() >> 11U) * 0x1p-53; };
    for (int round = 0; round < kRounds; ++round) {
        const Int3 n{2 + below(12), 2 + below(12), 2 + below(12)};
        const auto levels = static_cast<double>(1 + below(6));
        const std::uint64_t seed = random();
        const bool smoothed = below(2) == 0;
        FunctionVolume<float> volume(n, [&](const Int3& p) {
            const double u = smoothed ? smooth(p) + 0.1 * noise(p, seed) : noise(p, seed);
            return static_cast<float>(std::floor(levels * u));
        });
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(8));
        const StoreReader store(folder / "s");
        for (int query = 0; query < 4; ++query) {
            const double iso =
                below(2) == 0 ? static_cast<double>(below(7)) - 2 : levels * fraction();
            Settings with;
            with.error = below(2) == 0 ? 0 : levels * fraction();
            with.outside = below(2) == 0 ? Outside::below : Outside::above;
            if (below(4) != 0) {
                WorldBox box;
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const auto last = static_cast<double>(n[static_cast<int>(axis)] - 1);
                    const auto end = [&] {
                        const double x = (1.2 * fraction() - 0.1) * last;
                        switch (below(4)) {
                            case 0:
                                return std::round(x);
                            case 1:
                                return std::round(2 * x) / 2;
                            case 2:
                                return std::round(x) + (fraction() - 0.5) * 1e-12;
                            default:
                                return x;
                        }
                    };
                    do {
                        box.lo[axis] = end();
                        box.hi[axis] = end();
                    } while (
                        !(box.lo[axis] < box.hi[axis] && box.lo[axis] < last && box.hi[axis] > 0));
                }
                with.box = box;
            }
            CAPTURE(round, query, n.x, n.y, n.z, iso, with.error, static_cast<int>(with.outside));
            require_solid(store, iso, with);
            if (query < 2) {
                require_solid_of_cells(volume, store, iso, with.box);
            }
        }
    }
}

TEST_CASE("a closed mesh does not depend on chunks, threads and memory") {
    const auto all_levels = [](const Int3& p) {
        return static_cast<std::uint8_t>(40 + 9 * smooth(p) + 3 * noise(p));
    };
    FunctionVolume<std::uint8_t> volume({40, 37, 45}, all_levels);
    const WorldBox box{{0.5, 3, 7.25}, {33.5, 36, 41}};
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {3.0, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const double iso : {40.0, 43.5}) {
            std::string first;
            for (const int chunk : {8, 16, 64}) {
                const TemporaryFolder folder;
                make_store(volume, folder / "s", with_chunk(chunk));
                const StoreReader store(folder / "s");
                for (const int threads : {1, 2, 7}) {
                    for (const std::uint64_t memory : {64U << 20U, 1U << 30U}) {
                        const Closed r = closed(
                            store, iso, {error, box, Outside::below, threads, memory, true, cells});
                        if (first.empty()) {
                            require_watertight(r.mesh);
                            first = r.bytes;
                        }
                        CAPTURE(error, iso, chunk, threads, memory);
                        CHECK(r.bytes == first);
                    }
                }
            }
        }
    }
}

TEST_CASE("a closed surface is open only at missing values, and the report says so") {
    const auto f = [](const Int3& p) {
        const bool missing = p == Int3{7, 6, 5} || p == Int3{0, 3, 3};
        return missing ? std::numeric_limits<float>::quiet_NaN() : smooth_f(p);
    };
    FunctionVolume<float> volume({14, 12, 11}, f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {0.3, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const bool components : {false, true}) {
            SurfaceQuery query{.iso = -0.1};
            query.grid.cells = cells;
            query.stop = ErrorBound{error};
            query.stages.close = Outside::below;
            if (components) {
                query.stages.components.emplace();
            }
            MeshCollector mesh;
            const ExtractReport report = extract(store, query, mesh);
            REQUIRE(report.closing);
            CHECK(report.closing->outside == Outside::below);
            std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
            for (const auto& t : mesh.triangles) {
                for (std::size_t i = 0; i < 3; ++i) {
                    ++edges[{t[i], t[(i + 1) % 3]}];
                }
            }
            std::set<std::uint32_t> border;
            for (const auto& [edge, count] : edges) {
                CHECK(count == 1);
                if (edges.count({edge.second, edge.first}) == 0) {
                    for (const std::uint32_t v : {edge.first, edge.second}) {
                        border.insert(v);
                        // Not farther from a missing node than the surrounding cells.
                        const auto near = [&](const Int3& p) {
                            bool all = true;
                            for (std::size_t axis = 0; axis < 3; ++axis) {
                                const auto x = static_cast<double>(mesh.vertices[v][axis]);
                                const auto at = static_cast<double>(p[static_cast<int>(axis)]);
                                all = all && std::fabs(x - at) <= 1;
                            }
                            return all;
                        };
                        CHECK((near({7, 6, 5}) || near({0, 3, 3})));
                    }
                }
            }
            CHECK(!border.empty());
            CHECK(report.closing->border_vertices == border.size());
        }
    }
}

TEST_CASE("what cannot be closed is refused") {
    const TemporaryFolder folder;
    FunctionVolume<float> flat({9, 8, 1}, smooth_f);
    make_store(flat, folder / "flat", with_chunk(8));
    FunctionVolume<float> volume({9, 8, 7}, smooth_f);
    PreprocessOptions options = with_chunk(8);
    options.fields = {Field::deviation_bar, Field::normal_turn_plus};
    make_store(volume, folder / "s", options);
    MeshCollector mesh;
    SurfaceQuery query{.iso = 0};
    query.stages.close = Outside::above;
    CHECK_THROWS_AS(extract(Store(folder / "flat"), query, mesh), Error);
    CHECK_NOTHROW(extract(Store(folder / "s"), query, mesh));
    query.grid.culling = BackfaceCulling{{0, 0, 1}};
    CHECK_THROWS_AS(extract(Store(folder / "s"), query, mesh), Error);
}

namespace {

Mesh mesh_of(const MeshCollector& collected) {
    Mesh mesh;
    mesh.vertices = collected.vertices;
    mesh.triangles = collected.triangles;
    return mesh;
}

}  // namespace

TEST_CASE("vertices of caps have the function's value and the direction of its gradient") {
    const Cells cells = GENERATE(Cells::tetrahedra, Cells::hexahedra);
    FunctionVolume<float> volume({14, 17, 12}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    SurfaceQuery query{.iso = 0.1};
    query.stages.close = Outside::below;
    query.grid.cells = cells;
    query.attributes.normals = true;
    query.attributes.values = &store;
    query.box = WorldBox{{1, 2.25, 3.5}, {9.75, 12.5, 20}};
    MeshCollector mesh;
    extract(store, query, mesh);
    REQUIRE(!mesh.vertices.empty());
    std::size_t above = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        Double3 p{};
        std::copy(mesh.vertices[v].begin(), mesh.vertices[v].end(), p.begin());
        const double expected =
            cells == Cells::hexahedra ? trilinear_value(volume, p) : fine_value(volume, p);
        CHECK(mesh.values[v] == Approx(expected).margin(1e-5));
        CHECK(mesh.values[v] > 0.1 - 1e-5);
        above += mesh.values[v] > 0.1 + 1e-5 ? 1 : 0;
        const auto& n = mesh.normals[v];
        CHECK(std::hypot(n[0], n[1], n[2]) == Approx(1).margin(1e-5));
        // A node within the box: central differences.
        const Int3 node{std::llround(p[0]), std::llround(p[1]), std::llround(p[2])};
        const Double3 at{static_cast<double>(node.x), static_cast<double>(node.y),
                         static_cast<double>(node.z)};
        if (p == at && node.z < 11) {
            Double3 g{};
            for (int axis = 0; axis < 3; ++axis) {
                Int3 next = node;
                Int3 before = node;
                ++next[axis];
                --before[axis];
                g[static_cast<std::size_t>(axis)] = volume.at(before) - volume.at(next);
            }
            const double size = std::hypot(g[0], g[1], g[2]);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                CHECK(static_cast<double>(n[axis]) == Approx(g[axis] / size).margin(1e-4));
            }
        }
    }
    CHECK(above > 100);
}

TEST_CASE(
    "a closed surface stays closed within a distance, with a focus or camera, and without its "
    "small components") {
    const auto f = [](const Int3& p) {
        const bool speck = p.x % 6 == 5 && p.y % 6 == 5 && p.z % 6 == 5;
        return speck ? 1.0F : smooth_f(p);
    };
    const Cells cells = GENERATE(Cells::tetrahedra, Cells::hexahedra);
    FunctionVolume<float> volume({24, 21, 26}, f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    SurfaceQuery query{.iso = 0.1};
    query.stages.close = Outside::below;
    query.grid.cells = cells;
    query.box = WorldBox{{1, 2.25, 3.5}, {19.75, 20, 30}};
    MeshCollector full;
    extract(store, query, full);
    const double solid = enclosed(mesh_of(full));
    require_watertight(mesh_of(full));
    std::vector<SurfaceQuery> queries(4, query);
    queries[0].stop = DistanceBound{0.2};
    queries[1].stages.components.emplace().largest = 1;
    queries[2].stop = ErrorBound{0.01};
    queries[2].focus = Focus{{4, 4, 4}, {6, 6, 6}, 0.5};
    queries[3].camera = Camera{{-5, 3, 40}, 40, 64, 16};
    if (cells == Cells::hexahedra) {
        // With an error, hexahedral cells have no caps, and they do not support focus or camera.
        queries.resize(2);
    }
    queries.emplace_back(query).stop = DistanceBound{0.2};
    queries.back().effort = Effort::fast;
    queries.emplace_back(query).stop = TriangleBudgetByDistance{full.triangles.size() / 3};
    for (const SurfaceQuery& q : queries) {
        CAPTURE(&q - queries.data());
        MeshCollector mesh;
        const ExtractReport report = extract(store, q, mesh);
        REQUIRE(report.closing);
        CHECK(report.closing->outside == Outside::below);
        CHECK(mesh.triangles.size() < full.triangles.size());
        require_watertight(mesh_of(mesh));
        CHECK(enclosed(mesh_of(mesh)) == Approx(solid).epsilon(0.2));
    }
}
