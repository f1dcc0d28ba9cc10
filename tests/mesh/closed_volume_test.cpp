// Closed surfaces are watertight, and their volume is that of the solid in all tetrahedra, each
// clipped separately, or that of the hexahedra's surface in a volume with an additional layer of
// nodes.
#include <catch2/catch.hpp>
#include <cstdint>
#include <functional>
#include <random>

#include "query/simplify/proof/point_triangle.h"
#include "query/traverse/each_leaf.h"
#include "tests/mesh/closed_mesh.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr int kRounds = 100;  // number of random volumes

using Corners = std::array<Double3, 4>;

double volume_of(const Corners& v) {
    return std::fabs(dot(minus(v[1], v[0]), cross(minus(v[2], v[0]), minus(v[3], v[0])))) / 6;
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
        Point point{along(v[a], t, minus(v[b], v[a])), {}};
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

/// The part of a box of the world that is in the volume, or the volume, in lattice coordinates.
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

/// Checks the volume on one side of the isovalue in tetrahedra, also with an error.
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

/// None, and boxes whose faces pass through nodes, halfway between them, and anywhere.
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
