// Meshes within an error of the values: what the tests of several files make them of, and the error
// on their triangles by a search through every finest tetrahedron and by sampling.
#pragma once

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

namespace isonest::detail::test {

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

inline Simple extracted(const Store& store, const SurfaceQuery& query,
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

inline SurfaceQuery within(double iso, double error) {
    SurfaceQuery query{.iso = iso};
    query.stop = ErrorBound{error};
    query.effort = Effort::best;
    query.grid.cells = Cells::tetrahedra;
    return query;
}

/// The query for the surface that is simplified.
inline SurfaceQuery nested(SurfaceQuery query) {
    const double error = std::get<ErrorBound>(query.stop).value;
    query.stop = ErrorBound{nested_share(query.grid.vertices) * error};
    query.effort = Effort::none;
    return query;
}

inline Triangle corners_of(const Simple& mesh, const Corners& t, const Double3& spacing) {
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

inline Places places_of(const Simple& mesh, const Corners& t) {
    Places places{mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
    std::rotate(places.begin(), std::min_element(places.begin(), places.end()), places.end());
    return places;
}

inline bool is_cap(const Triangle& t, const Double3& lo, const Double3& hi) {
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

inline double bumpy(const Int3& p) {
    return 10 * smooth(p) + noise(p);
}

inline double ball(const Int3& p, const Double3& middle) {
    return std::hypot(static_cast<double>(p.x) - middle[0], static_cast<double>(p.y) - middle[1],
                      static_cast<double>(p.z) - middle[2]);
}

/// Winding number of a closed surface around a point, by the solid angles of its triangles (A. van
/// Oosterom, J. Strackee, 1983).
inline double winding(const Simple& mesh, const Double3& p) {
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
inline Triangle any_triangle(int i, const WorldLattice& lattice, std::mt19937& random) {
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
inline Triangle in_world(Triangle t, const WorldLattice& lattice) {
    for (Double3& corner : t) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            corner[axis] = lattice.origin[axis] + lattice.steps.along[axis] * corner[axis];
        }
    }
    return t;
}

}  // namespace isonest::detail::test
