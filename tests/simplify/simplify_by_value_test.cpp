// Surfaces simplified within an error of the values: the error on the final triangles, compared
// with a search through every finest tetrahedron and with sampling; topology; solids.
#include <catch2/catch.hpp>
#include <random>
#include <set>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>
#include <isonest/mesh_sink.h>

#include "query/extract/stages/simplify_stages.h"
#include "query/simplify/proof/trilinear_cover.h"
#include "query/simplify/proof/value_cover.h"
#include "store/lattice/simplex.h"
#include "tests/support/surface_samples.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Corners = std::array<std::uint64_t, 3>;

template <class T>
struct Volume {
    Volume(const Int3& n, const std::function<T(const Int3&)>& f,
           const Double3& spacing = {1, 1, 1})
        : function(n, f) {
        function.spacing_ = spacing;
        make_store(function, folder / "s", with_chunk(8));
        store.emplace(folder / "s");
    }
    FunctionVolume<T> function;
    TemporaryFolder folder;
    std::optional<Store> store;
};

struct Simple {
    std::vector<std::array<float, 3>> positions;
    std::vector<Corners> triangles;
    ExtractReport report;
};

Simple extracted(const Store& store, const SurfaceQuery& query,
                 const ExtractOptions& options = {}) {
    MeshCollector mesh;
    Simple out;
    out.report = extract(store, query, mesh, options);
    out.positions = mesh.vertices;
    for (const auto& t : mesh.triangles) {
        out.triangles.push_back({t[0], t[1], t[2]});
    }
    return out;
}

SurfaceQuery within(double iso, double error) {
    SurfaceQuery query{.iso = iso};
    query.stop = ErrorBound{error};
    query.effort = Effort::best;
    query.grid.cells = Cells::tetrahedra;
    return query;
}

/// The query for the surface that is simplified.
SurfaceQuery nested(SurfaceQuery query) {
    const double error = std::get<ErrorBound>(query.stop).value;
    query.stop = ErrorBound{nested_share(query.grid.vertices) * error};
    query.effort = Effort::none;
    return query;
}

Triangle corners_of(const Simple& mesh, const Corners& t, const Double3& spacing) {
    Triangle triangle{};
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            triangle[i][axis] = static_cast<double>(mesh.positions[t[i]][axis]) / spacing[axis];
        }
    }
    return triangle;
}

/// The part of a polygon where f >= 0.
template <class F>
std::vector<Double3> clipped(const std::vector<Double3>& polygon, const F& f) {
    std::vector<Double3> part;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const Double3& a = polygon[i];
        const Double3& b = polygon[(i + 1) % polygon.size()];
        if (f(a) >= 0) {
            part.push_back(a);
        }
        if ((f(a) < 0) != (f(b) < 0)) {
            part.push_back(along(a, f(a) / (f(a) - f(b)), minus(b, a)));
        }
    }
    return part;
}

/// The maximum of |f - iso| on a triangle in lattice coordinates: at the corners of its
/// intersections with the finest tetrahedra, so it is exact up to rounding.
template <class T>
double exact_max(const FunctionVolume<T>& volume, double iso, const Triangle& t) {
    Int3 low;
    Int3 high;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto [least, most] = std::minmax({t[0][a], t[1][a], t[2][a]});
        low[axis] = static_cast<std::int64_t>(std::floor(least));
        high[axis] = static_cast<std::int64_t>(std::floor(most));
    }
    double most = 0;
    const Int3 cells = high - low + Int3{1, 1, 1};
    for (std::int64_t c = 0; c < cells.product(); ++c) {
        const Int3 cell = low + cells.unlinear(c);
        std::vector<Double3> in_cell{t[0], t[1], t[2]};
        for (int axis = 0; axis < 3 && !in_cell.empty(); ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            const auto from = static_cast<double>(cell[axis]);
            in_cell = clipped(in_cell, [&](const Double3& p) { return p[a] - from; });
            in_cell = clipped(in_cell, [&](const Double3& p) { return from + 1 - p[a]; });
        }
        const auto inside = [&](const Double3& p, int axis) {
            const double y = p[static_cast<std::size_t>(axis)] - static_cast<double>(cell[axis]);
            return (cell[axis] & 1) != 0 ? 1 - y : y;
        };
        for (const auto& order : kAxisOrders) {
            std::vector<Double3> piece = in_cell;
            for (std::size_t i = 0; i < 2 && !piece.empty(); ++i) {
                piece = clipped(piece, [&](const Double3& p) {
                    return inside(p, order[i]) - inside(p, order[i + 1]);
                });
            }
            for (const Double3& p : piece) {
                most = std::max(most, std::fabs(fine_value(volume, p) - iso));
            }
        }
    }
    return most;
}

/// Like fine_value(), but nodes of negligible weight are ignored, such as a missing one beside the
/// point.
template <class T>
double value_beside_missing(const FunctionVolume<T>& volume, const Double3& p) {
    Double3 near{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double whole = std::round(p[axis]);
        near[axis] = std::fabs(p[axis] - whole) < 1e-5 ? whole : p[axis];
    }
    const double value = fine_value(volume, near);
    if (std::isfinite(value)) {
        return value;
    }
    // For a point on a face between two tetrahedra, use the other one.
    double other = value;
    for (const double step : {-1e-5, 1e-5}) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            Double3 q = near;
            q[axis] += step;
            const double beside = fine_value(volume, q);
            other = std::isfinite(beside) ? beside : other;
        }
    }
    return other;
}

template <class T>
void require_within(const Volume<T>& volume, double iso, double error,
                    const std::optional<WorldBox>& box = {},
                    VertexPlace vertices = VertexPlace::linear, Effort effort = Effort::best) {
    SurfaceQuery query = within(iso, error);
    query.effort = effort;
    query.grid.vertices = vertices;
    query.box = box;
    const Simple mesh = extracted(*volume.store, query);
    const Simple before = extracted(*volume.store, nested(query));
    CAPTURE(iso, error, before.triangles.size(), mesh.triangles.size());
    REQUIRE(before.triangles.size() > 50);
    REQUIRE(mesh.report.simplified_error->nested_triangles == before.triangles.size());
    REQUIRE(mesh.report.triangles == mesh.triangles.size());
    REQUIRE(mesh.report.tolerance == Approx(error));
    REQUIRE(mesh.report.error_bound <= error);
    REQUIRE(mesh.triangles.size() < before.triangles.size());
    const Shape shape = shape_of(mesh.triangles);
    REQUIRE(shape == shape_of(before.triangles));
    REQUIRE(shape.bad_edges == 0);
    REQUIRE(shape.repeated == 0);

    const bool has_missing = !std::isfinite(volume.function.at({2, 2, 2}));
    double most = 0;
    for (const Corners& t : mesh.triangles) {
        const Triangle at = corners_of(mesh, t, volume.function.spacing_);
        if (!has_missing) {
            most = std::max(most, exact_max(volume.function, iso, at));
        }
        const double longest =
            std::sqrt(std::max({square(minus(at[1], at[0])), square(minus(at[2], at[1])),
                                square(minus(at[0], at[2]))}));
        for_samples(at, 3 + static_cast<int>(4 * longest), [&](const Double3& p) {
            const double value = has_missing ? value_beside_missing(volume.function, p)
                                             : fine_value(volume.function, p);
            REQUIRE(std::isfinite(value));
            most = std::max(most, std::fabs(value - iso));
        });
    }
    // Unchanged triangles have vertices rounded to float32, and the data change by at most their
    // range between neighbouring nodes.
    const double rounding = 3 * mesh.report.coordinate_rounding *
                            (volume.store->max_value() - volume.store->min_value());
    REQUIRE(most <= mesh.report.error_bound + rounding);
    REQUIRE(most > 0);
}

/// Trilinear between the nodes of each finest cell; NaN beside a missing node, except for nodes of
/// negligible weight.
template <class T>
double trilinear(const FunctionVolume<T>& volume, const Double3& p) {
    const Int3 last = volume.nodes() - Int3{1, 1, 1};
    Int3 cell;
    Double3 share{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const double x = std::clamp(p[a], 0.0, static_cast<double>(last[axis]));
        cell[axis] = std::min(static_cast<std::int64_t>(std::floor(x)), last[axis] - 1);
        share[a] = x - static_cast<double>(cell[axis]);
    }
    double sum = 0;
    for (int i = 0; i < 8; ++i) {
        const Int3 corner{i & 1, i >> 1 & 1, i >> 2 & 1};
        double weight = 1;
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            weight *= corner[axis] != 0 ? share[a] : 1 - share[a];
        }
        const auto value = static_cast<double>(volume.at(cell + corner));
        if (weight > 1e-4 || (weight > 0 && std::isfinite(value))) {
            sum += weight * value;
        }
    }
    return sum;
}

template <class T>
double max_sampled(const FunctionVolume<T>& volume, double iso, const Triangle& t, int steps) {
    double most = 0;
    for_samples(t, steps, [&](const Double3& p) {
        const double value = trilinear(volume, p);
        REQUIRE(std::isfinite(value));
        most = std::max(most, std::fabs(value - iso));
    });
    return most;
}

using Places = std::array<std::array<float, 3>, 3>;

Places places_of(const Simple& mesh, const Corners& t) {
    Places places{mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
    std::rotate(places.begin(), std::min_element(places.begin(), places.end()), places.end());
    return places;
}

bool is_cap(const Triangle& t, const Double3& lo, const Double3& hi) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double x = t[0][axis];
        if (t[1][axis] == x && t[2][axis] == x && (x == lo[axis] || x == hi[axis])) {
            return true;
        }
    }
    return false;
}

/// For hexahedra: each new triangle is within the error, each other one within its reported bound;
/// the topology is that of full resolution. Returns the number of triangles.
template <class T>
std::size_t require_hexahedra_within(const Volume<T>& volume, double iso, double error,
                                     Effort effort, const std::optional<WorldBox>& box = {},
                                     const std::optional<Outside>& close = {}) {
    SurfaceQuery query{.iso = iso};
    query.grid.cells = Cells::hexahedra;
    query.box = box;
    query.stages.close = close;
    const Simple full = extracted(*volume.store, query);
    query.stop = ErrorBound{error};
    query.effort = effort;
    const Simple mesh = extracted(*volume.store, query);
    CAPTURE(iso, error, static_cast<int>(effort), full.triangles.size(), mesh.triangles.size());
    REQUIRE(full.triangles.size() > 50);
    REQUIRE(mesh.report.traversal.cells == Cells::hexahedra);
    REQUIRE(mesh.report.simplified_error->nested_triangles == full.triangles.size());
    REQUIRE(mesh.report.tolerance == Approx(error));
    REQUIRE(mesh.report.error_bound > 0);
    REQUIRE(mesh.report.error_bound <= error);
    REQUIRE(mesh.triangles.size() < full.triangles.size());
    const Shape shape = shape_of(mesh.triangles);
    REQUIRE(shape == shape_of(full.triangles));
    REQUIRE(shape.bad_edges == 0);
    REQUIRE(shape.repeated == 0);

    std::set<Places> kept;
    for (const Corners& t : full.triangles) {
        kept.insert(places_of(full, t));
    }
    const Int3 last = volume.function.nodes() - Int3{1, 1, 1};
    const WorldBox whole{
        {0, 0, 0},
        {static_cast<double>(last.x), static_cast<double>(last.y), static_cast<double>(last.z)}};
    const WorldBox& cut = box ? *box : whole;
    // Vertices are rounded to float32.
    const double rounding = 4 * mesh.report.coordinate_rounding *
                            (volume.store->max_value() - volume.store->min_value());
    const double full_bound = *mesh.report.simplified_error->full_bound;
    double largest_kept = 0;
    std::size_t made = 0;
    for (const Corners& t : mesh.triangles) {
        const Triangle at = corners_of(mesh, t, volume.function.spacing_);
        if (close && is_cap(at, cut.lo, cut.hi)) {
            continue;
        }
        const double longest =
            std::sqrt(std::max({square(minus(at[1], at[0])), square(minus(at[2], at[1])),
                                square(minus(at[0], at[2]))}));
        const double most =
            max_sampled(volume.function, iso, at, 5 + static_cast<int>(4 * longest));
        if (kept.count(places_of(mesh, t)) != 0) {
            largest_kept = std::max(largest_kept, most);
            REQUIRE(most <= full_bound + rounding);
        } else {
            ++made;
            REQUIRE(most <= mesh.report.error_bound + rounding);
        }
    }
    REQUIRE(made > 0);
    // The proven bound is not much larger than the actual error.
    REQUIRE(full_bound <= 1.5 * largest_kept + 1e-4 * error);
    return mesh.triangles.size();
}

double bumpy(const Int3& p) {
    return 10 * smooth(p) + noise(p);
}

double ball(const Int3& p, const Double3& middle) {
    return std::hypot(static_cast<double>(p.x) - middle[0], static_cast<double>(p.y) - middle[1],
                      static_cast<double>(p.z) - middle[2]);
}

/// Winding number of a closed surface around a point, by the solid angles of its triangles (A. van
/// Oosterom, J. Strackee, 1983).
double winding(const Simple& mesh, const Double3& p) {
    double sum = 0;
    for (const Corners& t : mesh.triangles) {
        Triangle at = corners_of(mesh, t, {1, 1, 1});
        for (Double3& corner : at) {
            corner = minus(corner, p);
        }
        const double a = length(at[0]);
        const double b = length(at[1]);
        const double c = length(at[2]);
        sum += 2 * std::atan2(dot(at[0], cross(at[1], at[2])), a * b * c + dot(at[0], at[1]) * c +
                                                                   dot(at[1], at[2]) * a +
                                                                   dot(at[2], at[0]) * b);
    }
    return sum / 12.566370614359172;
}

/// Triangle number i, in lattice coordinates, of various sizes, some at nodes, some without area.
Triangle any_triangle(int i, const WorldLattice& lattice, std::mt19937& random) {
    std::uniform_real_distribution<double> number(0, 1);
    const double size = i % 3 == 0 ? 25 : i % 3 == 1 ? 4 : 0.7;
    Triangle t{};
    const Double3 at{20 * number(random), 17 * number(random), 25 * number(random)};
    for (Double3& corner : t) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto last = static_cast<double>(lattice.nodes[static_cast<int>(axis)] - 1);
            corner[axis] = std::clamp(at[axis] + size * (number(random) - 0.5), 0.0, last);
            if (i % 5 == 0) {
                corner[axis] = std::round(corner[axis]);
            }
        }
    }
    if (i % 7 == 0) {
        t[2] = t[1];
    }
    return t;
}

/// From lattice coordinates.
Triangle in_world(Triangle t, const WorldLattice& lattice) {
    for (Double3& corner : t) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            corner[axis] = lattice.origin[axis] + lattice.steps.along[axis] * corner[axis];
        }
    }
    return t;
}

}  // namespace

TEST_CASE("A cover accepts a triangle exactly if every finest tetrahedron does") {
    const Volume<float> volume({21, 18, 26}, [](const Int3& p) {
        return static_cast<float>(5 * smooth(p) + 4 * noise(p));
    });
    class Numbers : public GridNumbers {
      public:
        explicit Numbers(const FunctionVolume<float>& of) : of_(of) {}
        double value(const Int3& node, int /*level*/) override { return of_.at(node); }
        // No element of a level differs from the data by more than their range.
        double deviation(const Int3& /*node*/) override { return 1000; }
        void rest() override {}

      private:
        const FunctionVolume<float>& of_;
    } numbers(volume.function);
    const WorldLattice lattice{{-3, 7, 100}, Double3{1, 0.5, 10}, volume.function.nodes()};
    const double iso = 2.5;
    std::mt19937 random(3);
    for (int i = 0; i < 600; ++i) {
        const Triangle t = any_triangle(i, lattice, random);
        const Triangle world = in_world(t, lattice);
        const double most = exact_max(volume.function, iso, t);
        ValueTree tree(numbers, Lattice(lattice.nodes), iso);
        ValueCover above(tree, lattice, most * (1 + 1e-9) + 1e-9);
        CAPTURE(i, most);
        REQUIRE(above.covers(world));
        REQUIRE(above.largest() == Approx(most).margin(1e-8));
        ValueCover below(tree, lattice, most * (1 - 1e-6));
        REQUIRE_FALSE(below.covers(world));
    }
}

TEST_CASE(
    "A trilinear cover accepts if all samples are within the error, and refuses if one is not") {
    const FunctionVolume<double> volume({21, 18, 26},
                                        [](const Int3& p) { return 5 * smooth(p) + 4 * noise(p); });
    class Numbers : public GridNumbers {
      public:
        explicit Numbers(const FunctionVolume<double>& of) : of_(of) {}
        double value(const Int3& node, int level) override {
            REQUIRE(level == 0);
            return node == missing ? std::numeric_limits<double>::quiet_NaN() : of_.at(node);
        }
        double deviation(const Int3& /*node*/) override { return 0; }
        void rest() override {}
        Int3 missing{-1, -1, -1};

      private:
        const FunctionVolume<double>& of_;
    } numbers(volume);
    const WorldLattice lattice{{-3, 7, 100}, Double3{1, 0.5, 10}, volume.nodes()};
    const double iso = 2.5;
    std::mt19937 random(4);
    for (int i = 0; i < 600; ++i) {
        const Triangle t = any_triangle(i, lattice, random);
        const Triangle world = in_world(t, lattice);
        const double most = max_sampled(volume, iso, t, 200);
        CAPTURE(i, most);
        TrilinearCover above(numbers, lattice, iso, most * 1.03 + 1e-6, 3);
        REQUIRE(above.covers(world));
        REQUIRE(above.largest() >= most * (1 - 1e-9) - 1e-9);
        REQUIRE(above.max_on(world) >= most * (1 - 1e-9) - 1e-9);
        REQUIRE(above.max_on(world) <= 1.2 * most + 1e-6);
        for (const int cuts : {0, 1, 3}) {
            TrilinearCover below(numbers, lattice, iso, most * (1 - 1e-6), cuts);
            REQUIRE_FALSE(below.covers(world));
        }
        const Double3& corner = world[0];
        const bool is_far = std::fabs(trilinear(volume, t[0]) - iso) > 0.7 * most;
        TrilinearCover part(numbers, lattice, iso, 0.7 * most, 3);
        REQUIRE(part.misses(corner) == is_far);
    }
    // A missing node excludes the surrounding cells, and no others.
    numbers.missing = {9, 8, 10};
    TrilinearCover any(numbers, lattice, iso, 1e6, 3);
    REQUIRE_FALSE(
        any.covers(in_world({{{8.5, 8.5, 9.5}, {8.6, 8.5, 9.5}, {8.5, 8.6, 9.5}}}, lattice)));
    REQUIRE_FALSE(any.covers(in_world({{{2, 2, 9.2}, {17, 4, 9.4}, {9, 16, 10.9}}}, lattice)));
    REQUIRE(any.misses(in_world({{{8.5, 8.5, 9.5}, {}, {}}}, lattice)[0]));
    REQUIRE_FALSE(std::isfinite(
        any.max_on(in_world({{{8.5, 8.5, 9.5}, {8.6, 8.5, 9.5}, {8.5, 8.6, 9.5}}}, lattice))));
    REQUIRE(any.covers(in_world({{{7.5, 8.5, 9.5}, {8, 8.5, 9.5}, {7.5, 8.6, 9.5}}}, lattice)));
}

TEST_CASE("A tree that is full is cleared, and what does not fit into an empty one is refused") {
    // So rough that every finest tetrahedron is visited.
    class Numbers : public GridNumbers {
      public:
        double value(const Int3& node, int /*level*/) override { return noise(node); }
        double deviation(const Int3& /*node*/) override { return 10; }
        void rest() override { ++rests; }
        int rests = 0;
    } numbers;
    const WorldLattice lattice{{0, 0, 0}, {}, {513, 513, 513}};
    ValueTree tree(numbers, Lattice(lattice.nodes), 0.5);
    ValueCover cover(tree, lattice, 0.6);
    // About 4 * 40^2 tetrahedra, and their ancestors.
    for (int i = 0; i < 12; ++i) {
        const double z = 40 * i + 0.3;
        REQUIRE(cover.covers({{{3, 3, z}, {83, 3, z + 1}, {3, 83, z + 2}}}));
    }
    REQUIRE(numbers.rests > 0);
    const int before = numbers.rests;
    REQUIRE_FALSE(cover.covers({{{0, 0, 3}, {512, 0, 100}, {0, 512, 300}}}));
    REQUIRE(numbers.rests == before + 1);
    REQUIRE(cover.covers({{{3, 3, 5}, {83, 3, 6}, {3, 83, 7}}}));
}

TEST_CASE(
    "All points of all triangles are within the error, and the topology is the nested grid's") {
    const Volume<float> rough({23, 30, 19},
                              [](const Int3& p) { return static_cast<float>(noise(p)); });
    for (const double error : {0.01, 0.1, 0.4}) {
        require_within(rough, 0.5, error);
    }
    const Volume<std::uint8_t> checkers({12, 15, 13}, [](const Int3& p) {
        return static_cast<std::uint8_t>(((p.x / 2 + p.y / 2 + p.z / 2) & 1) != 0 ? 200 : 10);
    });
    for (const double error : {5.0, 60.0}) {
        require_within(checkers, 100.5, error);
    }
    const Volume<float> sphere({33, 33, 33}, [](const Int3& p) {
        return static_cast<float>(ball(p, {15.3, 16.1, 15.9}));
    });
    for (const double error : {0.05, 0.5, 3.0}) {
        require_within(sphere, 11.2, error);
    }
    const Volume<double> waves({37, 22, 41}, [](const Int3& p) { return bumpy(p); });
    for (const double error : {0.3, 2.0, 8.0}) {
        require_within(waves, 1.7, error);
        require_within(waves, 1.7, error, {}, VertexPlace::exact);
        require_within(waves, 1.7, error, WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}});
    }
}

TEST_CASE("Node values at the isovalue, other voxels and integers stay within the error, too") {
    const Volume<std::int16_t> plateau({20, 21, 18}, [](const Int3& p) {
        return static_cast<std::int16_t>(std::clamp(3 * (ball(p, {9, 10, 8}) - 6), -5.0, 5.0) / 5 *
                                         (p.x % 5 == 0 ? 0 : 300));
    });
    for (const double error : {3.0, 50.0, 150.0}) {
        require_within(plateau, 0, error);
    }
    const Volume<float> flat_voxels(
        {24, 27, 15}, [](const Int3& p) { return static_cast<float>(bumpy(p)); }, {1, 1, 10});
    for (const double error : {0.5, 4.0}) {
        require_within(flat_voxels, 1.7, error);
    }
    const Volume<std::uint16_t> steps({26, 17, 33}, [](const Int3& p) {
        return static_cast<std::uint16_t>(1000 + 40 * bumpy(p));
    });
    for (const double error : {1.0, 30.0, 200.0}) {
        require_within(steps, 1060, error);
    }
}

TEST_CASE("Tetrahedra simplified fast are within the error, too") {
    const Volume<float> rough({23, 30, 19},
                              [](const Int3& p) { return static_cast<float>(noise(p)); });
    const Volume<double> waves({37, 22, 41}, [](const Int3& p) { return bumpy(p); });
    const Volume<float> holes({25, 24, 23}, [](const Int3& p) {
        const bool missing = p == Int3{2, 2, 2} || (ball(p, {12, 12, 12}) < 4 && p.x > 9);
        return missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(bumpy(p));
    });
    for (const double error : {0.05, 0.4}) {
        require_within(rough, 0.5, error, {}, VertexPlace::linear, Effort::fast);
    }
    for (const double error : {0.3, 8.0}) {
        require_within(waves, 1.7, error, {}, VertexPlace::linear, Effort::fast);
        require_within(waves, 1.7, error, WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}},
                       VertexPlace::exact, Effort::fast);
        require_within(holes, 1.7, error, {}, VertexPlace::linear, Effort::fast);
    }
}

TEST_CASE(
    "New triangles of hexahedra are within the error, the others are those at full resolution") {
    const Volume<float> rough({23, 30, 19},
                              [](const Int3& p) { return static_cast<float>(noise(p)); });
    const Volume<std::uint8_t> checkers({12, 15, 13}, [](const Int3& p) {
        return static_cast<std::uint8_t>(((p.x / 2 + p.y / 2 + p.z / 2) & 1) != 0 ? 200 : 10);
    });
    const Volume<float> sphere({33, 33, 33}, [](const Int3& p) {
        return static_cast<float>(ball(p, {15.3, 16.1, 15.9}));
    });
    const Volume<double> waves({37, 22, 41}, [](const Int3& p) { return bumpy(p); });
    const Volume<std::int16_t> plateau({20, 21, 18}, [](const Int3& p) {
        return static_cast<std::int16_t>(std::clamp(3 * (ball(p, {9, 10, 8}) - 6), -5.0, 5.0) / 5 *
                                         (p.x % 5 == 0 ? 0 : 300));
    });
    const Volume<float> flat_voxels(
        {24, 27, 15}, [](const Int3& p) { return static_cast<float>(bumpy(p)); }, {1, 1, 10});
    const Volume<std::uint16_t> steps({26, 17, 33}, [](const Int3& p) {
        return static_cast<std::uint16_t>(1000 + 40 * bumpy(p));
    });
    const Volume<float> holes({25, 24, 23}, [](const Int3& p) {
        const bool missing = p == Int3{2, 2, 2} || (ball(p, {12, 12, 12}) < 4 && p.x > 9);
        return missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(bumpy(p));
    });
    for (const Effort effort : {Effort::fast, Effort::best}) {
        for (const double error : {0.1, 0.4}) {
            require_hexahedra_within(rough, 0.5, error, effort);
        }
        require_hexahedra_within(checkers, 100.5, 90.0, effort);
        for (const double error : {0.05, 0.5, 3.0}) {
            require_hexahedra_within(sphere, 11.2, error, effort);
        }
        for (const double error : {0.3, 2.0, 8.0}) {
            require_hexahedra_within(waves, 1.7, error, effort);
            require_hexahedra_within(waves, 1.7, error, effort,
                                     WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}});
        }
        for (const double error : {50.0, 150.0}) {
            require_hexahedra_within(plateau, 0, error, effort);
        }
        for (const double error : {0.5, 4.0}) {
            require_hexahedra_within(flat_voxels, 1.7, error, effort);
        }
        for (const double error : {1.0, 200.0}) {
            require_hexahedra_within(steps, 1060, error, effort);
        }
        for (const double error : {0.5, 4.0, 10.0}) {
            require_hexahedra_within(holes, 1.7, error, effort);
        }
        for (const Outside outside : {Outside::below, Outside::above}) {
            require_hexahedra_within(waves, 1.7, 2.0, effort, {}, outside);
            require_hexahedra_within(waves, 1.7, 2.0, effort,
                                     WorldBox{{2.5, 3, 4.25}, {31, 18.75, 36.5}}, outside);
        }
    }
    const std::size_t fast = require_hexahedra_within(waves, 1.7, 2.0, Effort::fast);
    REQUIRE(require_hexahedra_within(waves, 1.7, 2.0, Effort::best) < fast);
}

TEST_CASE(
    "Solids of hexahedra contain what is clearly inside and nothing that is clearly outside") {
    const Volume<float> volume({26, 23, 29},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    std::mt19937 random(8);
    std::uniform_real_distribution<double> number(0, 1);
    for (const Effort effort : {Effort::fast, Effort::best}) {
        for (const bool has_box : {false, true}) {
            WorldBox box{{0, 0, 0}, {25, 22, 28}};
            SurfaceQuery query{.iso = 1.7};
            query.grid.cells = Cells::hexahedra;
            query.stop = ErrorBound{4};
            query.effort = effort;
            query.stages.close = Outside::below;
            if (has_box) {
                box = {{2.5, 3, 4.25}, {21, 18.75, 26.5}};
                query.box = box;
            }
            const Simple mesh = extracted(*volume.store, query);
            REQUIRE(shape_of(mesh.triangles).border_loops == 0);
            const double most =
                std::max(mesh.report.error_bound, *mesh.report.simplified_error->full_bound);
            int inside = 0;
            for (int i = 0; i < 400; ++i) {
                Double3 p{};
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    p[axis] = box.lo[axis] + number(random) * (box.hi[axis] - box.lo[axis]);
                }
                const auto face = static_cast<std::size_t>(i % 3);
                if (i % 2 == 0) {
                    p[face] = i % 4 == 0 ? box.lo[face] + 1e-3 : box.hi[face] - 1e-3;
                }
                const double above = trilinear(volume.function, p) - 1.7;
                if (std::fabs(above) > most * 1.01) {
                    CAPTURE(static_cast<int>(effort), has_box, p[0], p[1], p[2], above, most);
                    REQUIRE(winding(mesh, p) == Approx(above > 0 ? 1 : 0).margin(0.01));
                    inside += above > 0 ? 1 : 0;
                }
            }
            REQUIRE(inside > 20);
        }
    }
}

TEST_CASE("By default, the cells that read less are used") {
    const Volume<float> fine({41, 38, 35},
                             [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    const Volume<float> smooth_ball({129, 121, 125}, [](const Int3& p) {
        return static_cast<float>(ball(p, {64, 60, 62}) * ball(p, {64, 60, 62}));
    });
    int hexahedra = 0;
    int tetrahedra = 0;
    const auto compare = [&](const auto& volume, double iso, double error) {
        SurfaceQuery query = within(iso, error);
        const Simple nested = extracted(*volume.store, query);
        query.grid.cells.reset();
        query.effort = Effort::fast;
        const Simple fast = extracted(*volume.store, query);
        CAPTURE(error, nested.report.traversal.bytes_read, fast.report.traversal.bytes_read);
        REQUIRE(fast.report.traversal.bytes_read <= nested.report.traversal.bytes_read);
        const bool is_hexahedra = fast.report.traversal.cells == Cells::hexahedra;
        REQUIRE(fast.report.simplified_error->full_bound.has_value() == is_hexahedra);
        (is_hexahedra ? hexahedra : tetrahedra) += 1;
        query.grid.cells = fast.report.traversal.cells;
        REQUIRE(extracted(*volume.store, query).triangles == fast.triangles);
        // Options that only tetrahedra support make them the default.
        query.grid.cells.reset();
        query.grid.vertices = VertexPlace::exact;
        REQUIRE(extracted(*volume.store, query).report.traversal.cells == Cells::tetrahedra);
    };
    for (const double error : {0.1, 1.0, 4.0, 10.0}) {
        compare(fine, 1.7, error);
    }
    REQUIRE(hexahedra > 0);
    for (const double error : {0.01, 1.0, 10.0, 100.0, 1000.0}) {
        compare(smooth_ball, 900, error);
    }
    REQUIRE(tetrahedra > 0);
}

TEST_CASE("No triangle reaches into missing data") {
    const Volume<float> holes({25, 24, 23}, [](const Int3& p) {
        const bool missing = p == Int3{2, 2, 2} || (ball(p, {12, 12, 12}) < 4 && p.x > 9);
        return missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(bumpy(p));
    });
    for (const double error : {0.5, 4.0, 10.0}) {
        require_within(holes, 1.7, error);
    }
}

TEST_CASE("A closed solid contains what is clearly inside and nothing that is clearly outside") {
    const Volume<float> volume({26, 23, 29},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    const double iso = 1.7;
    std::mt19937 random(8);
    std::uniform_real_distribution<double> number(0, 1);
    for (const double error : {1.0, 4.0}) {
        for (const Outside outside : {Outside::below, Outside::above}) {
            for (const bool has_box : {false, true}) {
                WorldBox box{{0, 0, 0}, {25, 22, 28}};
                SurfaceQuery query = within(iso, error);
                query.stages.close = outside;
                if (has_box) {
                    box = {{2.5, 3, 4.25}, {21, 18.75, 26.5}};
                    query.box = box;
                }
                const Simple mesh = extracted(*volume.store, query);
                const Simple before = extracted(*volume.store, nested(query));
                CAPTURE(error, static_cast<int>(outside), has_box, mesh.triangles.size());
                const Shape shape = shape_of(mesh.triangles);
                REQUIRE(shape == shape_of(before.triangles));
                REQUIRE(shape.border_loops == 0);
                REQUIRE(mesh.triangles.size() < before.triangles.size() / 2);
                int inside = 0;
                for (int i = 0; i < 300; ++i) {
                    Double3 p{};
                    for (std::size_t axis = 0; axis < 3; ++axis) {
                        const double share = number(random);
                        p[axis] = box.lo[axis] + share * (box.hi[axis] - box.lo[axis]);
                    }
                    // Half of them next to a face, where the caps are.
                    const auto face = static_cast<std::size_t>(i % 3);
                    if (i % 2 == 0) {
                        p[face] = i % 4 == 0 ? box.lo[face] + 1e-3 : box.hi[face] - 1e-3;
                    }
                    const double above = fine_value(volume.function, p) - iso;
                    if (std::fabs(above) < error * 1.01) {
                        continue;
                    }
                    const bool is_solid = (above > 0) == (outside == Outside::below);
                    const double expected = is_solid ? (outside == Outside::below ? 1 : -1) : 0;
                    REQUIRE(winding(mesh, p) == Approx(expected).margin(0.01));
                    inside += is_solid ? 1 : 0;
                }
                REQUIRE(inside > 20);
            }
        }
    }
}

TEST_CASE("Caps cover what is clearly inside, once, and nothing that is clearly outside") {
    const Int3 n{22, 19, 20};
    const Volume<float> rough(n, [](const Int3& p) {
        return static_cast<float>(std::sin(0.9 * p.x) + std::cos(0.8 * p.y + p.z) + noise(p));
    });
    for (const double error : {0.2, 0.5, 0.8}) {
        SurfaceQuery query = within(0.6, error);
        query.stages.close = Outside::below;
        const Simple mesh = extracted(*rough.store, query);
        int inside = 0;
        for (int axis = 0; axis < 3; ++axis) {
            for (const std::int64_t at : {std::int64_t{0}, n[axis] - 1}) {
                const auto face = static_cast<std::size_t>(axis);
                const std::size_t u = (face + 1) % 3;
                const std::size_t v = (face + 2) % 3;
                std::vector<Triangle> caps;
                for (const Corners& t : mesh.triangles) {
                    const Triangle corners = corners_of(mesh, t, {1, 1, 1});
                    if (std::all_of(corners.begin(), corners.end(), [&](const Double3& p) {
                            return p[face] == static_cast<double>(at);
                        })) {
                        caps.push_back(corners);
                    }
                }
                for (double a = 0.037; a < static_cast<double>(n[static_cast<int>(u)] - 1);
                     a += 0.113) {
                    for (double b = 0.041; b < static_cast<double>(n[static_cast<int>(v)] - 1);
                         b += 0.117) {
                        Double3 p{};
                        p[face] = static_cast<double>(at);
                        p[u] = a;
                        p[v] = b;
                        const double above = fine_value(rough.function, p) - 0.6;
                        if (std::fabs(above) <= error) {
                            continue;
                        }
                        const auto covering =
                            std::count_if(caps.begin(), caps.end(), [&](const Triangle& t) {
                                const auto side = [&](std::size_t i) {
                                    const Double3 e = minus(t[(i + 1) % 3], t[i]);
                                    const Double3 d = minus(p, t[i]);
                                    return e[u] * d[v] - e[v] * d[u] > 0;
                                };
                                return side(0) == side(1) && side(1) == side(2);
                            });
                        CAPTURE(error, axis, at, a, b, above);
                        REQUIRE(covering == (above > 0 ? 1 : 0));
                        inside += above > 0 ? 1 : 0;
                    }
                }
            }
        }
        REQUIRE(inside > 100);
    }
}

TEST_CASE("A mesh simplified by value does not depend on chunks, threads and memory") {
    FunctionVolume<float> volume(
        {58, 61, 55}, [](const Int3& p) { return static_cast<float>(bumpy(p) + 2 * noise(p, 3)); });
    std::array<std::string, 3> first;
    for (const int chunk : {8, 32}) {
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(chunk));
        const Store store(folder / "s");
        for (const auto& [threads, memory] :
             {std::pair{1, std::uint64_t{1} << 30U}, std::pair{3, std::uint64_t{80} << 20U}}) {
            ExtractOptions options;
            options.threads = threads;
            options.memory = memory;
            for (std::size_t i = 0; i < first.size(); ++i) {
                SurfaceQuery query = within(1.7, 0.5);
                if (i > 0) {
                    query.grid.cells = Cells::hexahedra;
                    query.effort = i == 1 ? Effort::fast : Effort::best;
                }
                const auto sink = open_mesh_file(folder / "m.ply", {.replace = true});
                const ExtractReport r = extract(store, query, *sink, options);
                CAPTURE(chunk, threads, memory, i);
                // Several blocks.
                REQUIRE(r.simplified_error->nested_triangles > (i == 0 ? 90000 : 40000));
                const std::string bytes = read_file(folder / "m.ply");
                first[i] = first[i].empty() ? bytes : first[i];
                REQUIRE(bytes == first[i]);
            }
        }
    }
}

TEST_CASE("A simplified surface does not exceed the requested number of triangles") {
    const Volume<float> volume({25, 23, 27},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    SurfaceQuery at_full{.iso = 1.7};
    at_full.grid.cells = Cells::tetrahedra;
    const std::uint64_t full = extracted(*volume.store, at_full).triangles.size();
    for (const std::uint64_t most : {full / 50, full / 10}) {
        SurfaceQuery query{.iso = 1.7};
        query.grid.cells = Cells::tetrahedra;
        query.stop = TriangleBudgetByError{most};
        const Simple mesh = extracted(*volume.store, query);
        REQUIRE(mesh.report.within_budget == true);
        REQUIRE(mesh.triangles.size() <= most);
        REQUIRE(mesh.triangles.size() > most / 3);
        const Simple same = extracted(*volume.store, within(1.7, mesh.report.tolerance));
        REQUIRE(same.triangles == mesh.triangles);
        query.grid.cells = Cells::hexahedra;
        for (const Effort effort : {Effort::fast, Effort::best}) {
            query.effort = effort;
            const Simple cubes = extracted(*volume.store, query);
            REQUIRE(cubes.triangles.size() <= most);
            REQUIRE(cubes.triangles.size() > most / 3);
            SurfaceQuery again = query;
            again.stop = ErrorBound{cubes.report.tolerance};
            REQUIRE(extracted(*volume.store, again).triangles == cubes.triangles);
        }
        query.grid.cells.reset();
        query.effort = Effort::none;
        REQUIRE(extracted(*volume.store, query).report.tolerance > mesh.report.tolerance);
    }
}

TEST_CASE("Without an error nothing is simplified, and invalid queries are refused") {
    const Volume<float> volume({17, 18, 19},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    SurfaceQuery at_full{.iso = 1.7};
    at_full.grid.cells = Cells::tetrahedra;
    const Simple full = extracted(*volume.store, at_full);
    at_full.stop = ErrorBound{0};
    const Simple zero = extracted(*volume.store, at_full);
    REQUIRE(zero.triangles == full.triangles);
    REQUIRE(zero.positions == full.positions);
    REQUIRE_FALSE(zero.report.simplified_error);

    SurfaceQuery query = within(1.7, 1);
    query.focus = Focus{};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("focus"));
    query.focus.reset();
    query.camera = Camera{};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("camera"));
    query.camera.reset();
    query.stop = ErrorBound{1, false, ErrorIndicator::estimate};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("estimate"));
    query.stop = ErrorBound{-1};
    REQUIRE_THROWS_AS(extracted(*volume.store, query), Error);
    query.stop = ErrorBound{0};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("effort"));
    query.stop = FieldThreshold{Field::deviation_bar, 1};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("threshold"));

    const Volume<float> flat({17, 18, 1},
                             [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    REQUIRE_THROWS_WITH(extracted(*flat.store, within(1.7, 1)), Catch::Contains("distance"));

    ExtractOptions little;
    little.memory = 24U << 20U;
    try {
        extracted(*volume.store, within(1.7, 1), little);
        FAIL("24 MiB were enough");
    } catch (const Error& e) {
        REQUIRE(e.kind() == ErrorKind::limit);
        REQUIRE_THAT(e.what(), Catch::Contains("simplification within an error"));
    }
}
