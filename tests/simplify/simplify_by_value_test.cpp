// Surfaces that are simplified within an error of the values: the error on the final triangles,
// against a search through every finest tetrahedron and against sampling; topology; solids.
#include <catch2/catch.hpp>
#include <random>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>
#include <isonest/mesh_sink.h>

#include "query/extract/stages/error_stage.h"
#include "query/simplify/by_value/value_cover.h"
#include "store/lattice/bisection.h"
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
    query.stop = SimplifiedErrorBound{{error}};
    return query;
}

/// What is simplified.
SurfaceQuery nested(SurfaceQuery query) {
    const double error = std::get<SimplifiedErrorBound>(query.stop).bound.value;
    query.stop = ErrorBound{nested_share(query.grid.vertices) * error};
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

/// The largest |f - iso| on a triangle in lattice coordinates: at the corners of what each finest
/// tetrahedron cuts out of it, so it is exact but for rounding.
template <class T>
double exact_most(const FunctionVolume<T>& volume, double iso, const Triangle& t) {
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

/// As fine_value(), but nodes that hardly count do not count: a missing one beside the point.
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
    // On a face between two tetrahedra, the other one.
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
                    VertexPlace vertices = VertexPlace::linear) {
    SurfaceQuery query = within(iso, error);
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
            most = std::max(most, exact_most(volume.function, iso, at));
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
    // Triangles that stay as they were have vertices that are rounded to float32, and the data
    // change by no more than their range from node to node.
    const double rounding = 3 * mesh.report.coordinate_rounding *
                            (volume.store->max_value() - volume.store->min_value());
    REQUIRE(most <= mesh.report.error_bound + rounding);
    REQUIRE(most > 0);
}

double bumpy(const Int3& p) {
    return 10 * smooth(p) + noise(p);
}

double ball(const Int3& p, const Double3& middle) {
    return std::hypot(static_cast<double>(p.x) - middle[0], static_cast<double>(p.y) - middle[1],
                      static_cast<double>(p.z) - middle[2]);
}

/// How often a closed surface goes around a point, by the solid angles of its triangles (A. van
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

}  // namespace

TEST_CASE("A cover says yes exactly where every finest tetrahedron does") {
    const Volume<float> volume({21, 18, 26}, [](const Int3& p) {
        return static_cast<float>(5 * smooth(p) + 4 * noise(p));
    });
    class Numbers : public GridNumbers {
      public:
        explicit Numbers(const FunctionVolume<float>& of) : of_(of) {}
        double value(const Int3& node, int /*level*/) override { return of_.at(node); }
        // No element of a level differs more from the data than their range.
        double deviation(const Int3& /*node*/) override { return 1000; }
        void rest() override {}

      private:
        const FunctionVolume<float>& of_;
    } numbers(volume.function);
    const WorldLattice lattice{{-3, 7, 100}, {1, 0.5, 10}, volume.function.nodes()};
    const double iso = 2.5;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> number(0, 1);
    for (int i = 0; i < 600; ++i) {
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
        Triangle world = t;
        for (Double3& corner : world) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                corner[axis] = lattice.origin[axis] + lattice.spacing[axis] * corner[axis];
            }
        }
        const double most = exact_most(volume.function, iso, t);
        ValueTree tree(numbers, Lattice(lattice.nodes), iso);
        ValueCover above(tree, lattice, most * (1 + 1e-9) + 1e-9);
        CAPTURE(i, most);
        REQUIRE(above.covers(world));
        REQUIRE(above.largest() == Approx(most).margin(1e-8));
        ValueCover below(tree, lattice, most * (1 - 1e-6));
        REQUIRE_FALSE(below.covers(world));
    }
}

TEST_CASE("A tree that is full is cleared, and what does not fit into an empty one is refused") {
    // So rough that every finest tetrahedron is met.
    class Numbers : public GridNumbers {
      public:
        double value(const Int3& node, int /*level*/) override { return noise(node); }
        double deviation(const Int3& /*node*/) override { return 10; }
        void rest() override { ++rests; }
        int rests = 0;
    } numbers;
    const WorldLattice lattice{{0, 0, 0}, {1, 1, 1}, {513, 513, 513}};
    ValueTree tree(numbers, Lattice(lattice.nodes), 0.5);
    ValueCover cover(tree, lattice, 0.6);
    // About 4 * 40^2 tetrahedra, and those above them.
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

TEST_CASE("Values at the isovalue, other voxels and integers stay within the error, too") {
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

TEST_CASE("No triangle reaches into what is missing") {
    const Volume<float> holes({25, 24, 23}, [](const Int3& p) {
        const bool missing = p == Int3{2, 2, 2} || (ball(p, {12, 12, 12}) < 4 && p.x > 9);
        return missing ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(bumpy(p));
    });
    for (const double error : {0.5, 4.0, 10.0}) {
        require_within(holes, 1.7, error);
    }
}

TEST_CASE("A closed solid holds what is clearly inside and nothing that is clearly outside") {
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

TEST_CASE("The mesh does not depend on chunks, threads and memory") {
    FunctionVolume<float> volume(
        {58, 61, 55}, [](const Int3& p) { return static_cast<float>(bumpy(p) + 2 * noise(p, 3)); });
    std::string first;
    for (const int chunk : {8, 32}) {
        const TemporaryFolder folder;
        make_store(volume, folder / "s", with_chunk(chunk));
        const Store store(folder / "s");
        for (const auto& [threads, memory] :
             {std::pair{1, std::uint64_t{1} << 30U}, std::pair{3, std::uint64_t{80} << 20U}}) {
            ExtractOptions options;
            options.threads = threads;
            options.memory = memory;
            const auto sink = open_mesh_file(folder / "m.ply", {.replace = true});
            const ExtractReport r = extract(store, within(1.7, 0.5), *sink, options);
            CAPTURE(chunk, threads, memory);
            // Several blocks.
            REQUIRE(r.simplified_error->nested_triangles > 90000);
            const std::string bytes = read_file(folder / "m.ply");
            first = first.empty() ? bytes : first;
            REQUIRE(bytes == first);
        }
    }
}

TEST_CASE("A number of triangles is met by a simplified surface, too") {
    const Volume<float> volume({25, 23, 27},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    const std::uint64_t full = extracted(*volume.store, {.iso = 1.7}).triangles.size();
    for (const std::uint64_t most : {full / 50, full / 10}) {
        SurfaceQuery query{.iso = 1.7};
        query.stop = ErrorBudget{.most = most, .simplified = true};
        const Simple mesh = extracted(*volume.store, query);
        REQUIRE(mesh.report.within_budget == true);
        REQUIRE(mesh.triangles.size() <= most);
        REQUIRE(mesh.triangles.size() > most / 3);
        const Simple same = extracted(*volume.store, within(1.7, mesh.report.tolerance));
        REQUIRE(same.triangles == mesh.triangles);
        query.stop = ErrorBudget{.most = most};
        REQUIRE(extracted(*volume.store, query).report.tolerance > mesh.report.tolerance);
    }
}

TEST_CASE("Without an error nothing is simplified; what makes no sense is refused") {
    const Volume<float> volume({17, 18, 19},
                               [](const Int3& p) { return static_cast<float>(bumpy(p)); });
    const Simple full = extracted(*volume.store, {.iso = 1.7});
    const Simple zero = extracted(*volume.store, within(1.7, 0));
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
    query.stop = SimplifiedErrorBound{{1, false, Guarantee::estimate}};
    REQUIRE_THROWS_WITH(extracted(*volume.store, query), Catch::Contains("estimate"));
    query.stop = SimplifiedErrorBound{{-1}};
    REQUIRE_THROWS_AS(extracted(*volume.store, query), Error);

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
