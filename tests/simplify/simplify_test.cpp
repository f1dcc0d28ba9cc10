// Distances between triangles and surfaces, compared with sampling and with brute force over all
// pairs.
#include <catch2/catch.hpp>
#include <random>

#include "query/mesh/vertex_stars.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/proof/point_triangle.h"
#include "query/simplify/proof/projected_cover.h"
#include "query/simplify/proof/surface_distance.h"
#include "tests/support/surface_samples.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

Triangle triangle_of(std::mt19937& random, int kind, double size) {
    std::uniform_real_distribution<double> number(-1, 1);
    const auto point = [&] {
        return Double3{size * number(random), size * number(random), size * number(random)};
    };
    Triangle t{point(), point(), point()};
    if (kind == 1) {
        t[2] = t[0];
    } else if (kind == 2) {
        t[1] = t[2] = t[0];
    } else if (kind == 3) {
        t[2] = along(t[0], number(random) * 2, minus(t[1], t[0]));
    } else if (kind == 4) {
        t[2] = along(t[1], 1e-9, t[2]);
    }
    return t;
}

/// Random triangles around a wavy plane.
struct Surface {
    std::vector<std::array<float, 3>> positions;
    std::vector<TriangleTree::Corners> triangles;

    Surface(std::mt19937& random, std::uint32_t count) {
        for (std::uint32_t i = 0; i < count; ++i) {
            const Triangle t = triangle_of(random, static_cast<int>(i % 11), 0.4);
            const Triangle at = triangle_of(random, 0, 3);
            for (const Double3& p : t) {
                positions.push_back({static_cast<float>(p[0] + at[0][0]),
                                     static_cast<float>(p[1] + at[0][1]),
                                     static_cast<float>(p[2] + at[0][2] / 4)});
            }
            triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
        }
    }
};

/// Whether collapsing the edge preserves the topology of the surface.
bool is_possible(const Patch& patch, std::uint32_t from, std::uint32_t to) {
    std::vector<bool> locked(patch.positions.size());
    CornerMesh mesh(patch.positions.size(), patch.triangles, locked);
    return StarCollapse(patch.positions, patch.box, patch.shared, locked, mesh).look(from, to);
}

}  // namespace

TEST_CASE("The distance of a point from a triangle is the minimum that a search finds") {
    std::mt19937 random(1);
    for (int i = 0; i < 3000; ++i) {
        const Triangle t = triangle_of(random, i % 6, i % 7 == 0 ? 1e-3 : 1);
        const Double3 p = triangle_of(random, 0, i % 5 == 0 ? 0.1 : 2)[0];
        const double found = std::sqrt(square_distance(p, t));
        double least = found + 1;
        double step = 0;
        constexpr int kSteps = 24;
        for_samples(t, kSteps, [&](const Double3& q) {
            least = std::min(least, std::sqrt(square(minus(p, q))));
        });
        for (int e = 0; e < 3; ++e) {
            step = std::max(step, std::sqrt(square(minus(t[(e + 1) % 3], t[e]))) / kSteps);
        }
        // For a needle, double precision gives a point that is not exactly the nearest one.
        REQUIRE(found <= least + (i % 6 == 4 ? 1e-3 : 1e-9));
        REQUIRE(found >= least - step - 1e-9);
        for (int turn = 1; turn < 3; ++turn) {
            const Triangle turned{t[turn], t[(turn + 1) % 3], t[(turn + 2) % 3]};
            REQUIRE(std::sqrt(square_distance(p, turned)) ==
                    Approx(found).margin(i % 6 == 4 ? 1e-3 : 1e-7));
        }
    }
}

TEST_CASE(
    "A prepared triangle gives the same distance as the triangle, unless it exceeds the limit") {
    std::mt19937 random(7);
    int within = 0;
    for (int i = 0; i < 20000; ++i) {
        const Triangle t = triangle_of(random, i % 6, i % 7 == 0 ? 1e-3 : 1);
        const Double3 p = triangle_of(random, 0, i % 5 == 0 ? 0.1 : 2)[0];
        const double limit = 0.1 * (1 + i % 20);
        const double truth = square_distance(p, t);
        const double found = PreparedTriangle(t).square_distance_within(p, limit);
        if (truth <= limit * limit) {
            ++within;
            REQUIRE(found == Approx(truth).epsilon(1e-9).margin(1e-18));
        } else {
            REQUIRE(found > limit * limit);
        }
    }
    REQUIRE(within > 5000);
}

TEST_CASE("A tree finds the nearest of all triangles, and visits every near one") {
    std::mt19937 random(2);
    for (const std::uint32_t count : {0U, 1U, 4U, 5U, 200U}) {
        const Surface s(random, count);
        const TriangleTree tree(s.positions, s.triangles);
        for (int i = 0; i < 200; ++i) {
            const Double3 p = triangle_of(random, 0, 3)[0];
            const double most = i % 3 == 0 ? 1e300 : 0.05 * i;
            double least = most;
            std::vector<bool> is_near(count);
            for (std::uint32_t t = 0; t < count; ++t) {
                const double d = square_distance(p, tree.triangle(t));
                least = std::min(least, d);
                is_near[t] = d <= most;
            }
            const TriangleTree::Found found = tree.nearest(p, most);
            REQUIRE((found.triangle == TriangleTree::kNone) ==
                    (std::count(is_near.begin(), is_near.end(), true) == 0));
            if (found.triangle != TriangleTree::kNone) {
                REQUIRE(found.square_distance == least);
            }
            std::vector<bool> visited(count);
            REQUIRE_FALSE(tree.near(p, most, [&](std::uint32_t t) {
                REQUIRE_FALSE(visited[t]);
                visited[t] = true;
                return false;
            }));
            for (std::uint32_t t = 0; t < count; ++t) {
                REQUIRE((!is_near[t] || visited[t]));
            }
        }
    }
}

TEST_CASE(
    "No triangle counts as near if a sample of it is farther away, and clearly near ones do") {
    std::mt19937 random(3);
    int near = 0;
    int far = 0;
    for (int i = 0; i < 1500; ++i) {
        const Surface s(random, i % 4 == 0 ? 3 : 150);
        const TriangleTree tree(s.positions, s.triangles);
        const double limit = i % 3 == 0 ? 0.05 : 0.3 + 0.001 * i;
        SurfaceDistance distance(tree, limit);
        const auto pick = static_cast<std::uint32_t>(random() % s.triangles.size());
        Triangle t = tree.triangle(pick);
        const Triangle moved = triangle_of(random, 0, limit);
        for (std::size_t c = 0; c < 3; ++c) {
            t[c] = along(t[c], i % 2 == 0 ? 0.4 : 1, moved[c]);
        }
        if (i % 10 == 0) {
            t = triangle_of(random, i % 5, 2);
        }
        double worst = 0;
        for_samples(t, 20, [&](const Double3& q) {
            worst = std::max(worst, std::sqrt(tree.nearest(q, 1e300).square_distance));
        });
        bool is_within = false;  // within the limit of one triangle
        for (std::uint32_t u = 0; u < s.triangles.size(); ++u) {
            is_within = is_within || std::all_of(t.begin(), t.end(), [&](const Double3& c) {
                            return square_distance(c, tree.triangle(u)) <= 0.999 * limit * limit;
                        });
        }
        if (distance.serves(t)) {
            REQUIRE(worst <= limit * (1 + 1e-9));
            REQUIRE(distance.largest() <= limit);
            REQUIRE(distance.largest() >= worst - 1e-9);
            ++near;
        } else {
            REQUIRE_FALSE(is_within);
            ++far;
        }
        if (distance.serves(t)) {
            for_samples(t, 12, [&](const Double3& q) {
                REQUIRE(std::any_of(
                    distance.witnesses().begin(), distance.witnesses().end(), [&](std::uint32_t u) {
                        return square_distance(q, tree.triangle(u)) <= limit * limit * (1 + 1e-9);
                    }));
            });
        }
    }
    REQUIRE(near > 250);
    REQUIRE(far > 150);
}

TEST_CASE("All samples of a triangle that is covered by projection are near") {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> share(-1, 1);
    std::array<int, 2> covered{};
    for (const double height : {0.0, 0.2, 0.6, 1.5}) {
        for (const bool is_grid : {true, false}) {
            const Patch surface =
                is_grid ? wavy_grid(21, height) : torus(30, 12, 5, 1.5, height / 4);
            const TriangleTree tree(surface.positions, surface.triangles);
            for (const double limit : {0.05, 0.4, 3.0}) {
                ProjectedCover cover(surface.positions, surface.triangles, limit);
                for (int i = 0; i < 400; ++i) {
                    // Corners a few steps from each other.
                    PatchTriangle t{};
                    t[0] = static_cast<std::uint32_t>(random() % surface.positions.size());
                    for (std::size_t c = 1; c < 3; ++c) {
                        t[c] = static_cast<std::uint32_t>(
                            (t[0] + random() % 5 + (is_grid ? 21 : 12) * (random() % 5)) %
                            surface.positions.size());
                    }
                    const auto& p = surface.positions;
                    if (has_no_area(p[t[0]], p[t[1]], p[t[2]])) {
                        continue;
                    }
                    // As it is, and with corners that are off the surface.
                    for (const double beside : {0.0, 0.3}) {
                        Triangle at = surface.at(t);
                        for (Double3& corner : at) {
                            corner = along(corner, beside,
                                           {share(random), share(random), share(random)});
                        }
                        const std::optional<double> off = cover.covers(at, t[0]);
                        if (!off) {
                            continue;
                        }
                        ++covered[beside > 0 ? 1 : 0];
                        REQUIRE(*off <= limit);
                        for_samples(at, 12, [&](const Double3& q) {
                            REQUIRE(std::sqrt(tree.nearest(q, 1e300).square_distance) <=
                                    *off + 1e-9);
                        });
                    }
                }
            }
        }
    }
    REQUIRE(covered[0] > 1000);
    REQUIRE(covered[1] > 500);
}

TEST_CASE("A hole or a border under a triangle is not covered by projection") {
    Patch grid = wavy_grid(9, 0);
    const auto covers = [&](const PatchTriangle& t) {
        return ProjectedCover(grid.positions, grid.triangles, 100)
            .covers(grid.at(t), t[0])
            .has_value();
    };
    REQUIRE(covers({0, 8, 72}));  // its edges are on the border
    REQUIRE(covers({8, 80, 72}));
    REQUIRE_FALSE(covers({0, 72, 8}));  // seen from behind
    grid.triangles.erase(grid.triangles.begin() + 2 * 20);
    REQUIRE_FALSE(covers({0, 8, 72}));
    REQUIRE(covers({8, 80, 72}));
}

TEST_CASE("A border does not leave its face of the box") {
    Patch corner;
    corner.positions = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}};
    corner.triangles = {{0, 1, 3}, {2, 0, 3}};
    finish(corner);
    const auto is_allowed = [&] { return is_possible(corner, 0, 1); };
    // From 2 to 1: through the interior, although all three have the same x.
    corner.box.lo = {-5, 0, 0};
    REQUIRE_FALSE(is_allowed());
    corner.box.lo = {0, -5, -5};
    REQUIRE(is_allowed());
    corner.box.lo = {0, 0, 0};  // a corner of the box is kept
    REQUIRE_FALSE(is_allowed());
    corner.box.lo = {-5, -5, -5};  // a border somewhere inside, beside missing values
    REQUIRE(is_allowed());
}

TEST_CASE("A cap does not leave its face of the box") {
    // A square pyramid on the plane z = 0, whose base has a vertex in the middle.
    Patch solid;
    solid.positions = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {1, 1, 0}, {1, 1, 1}};
    solid.triangles = {{1, 0, 4}, {2, 1, 4}, {3, 2, 4}, {0, 3, 4},
                       {0, 1, 5}, {1, 2, 5}, {2, 3, 5}, {3, 0, 5}};
    finish(solid);
    solid.box.lo = {-5, -5, 0};
    const auto is_allowed = [&](std::uint32_t from, std::uint32_t to) {
        return is_possible(solid, from, to);
    };
    REQUIRE(is_allowed(4, 0));
    REQUIRE_FALSE(is_allowed(0, 5));
    solid.positions[5] = {0.1F, 0.1F, 1};
    solid.box.lo = {-5, -5, -5};
    REQUIRE(is_allowed(0, 5));
    solid.box.lo = {-5, -5, 0};
    REQUIRE_FALSE(is_allowed(0, 5));
}

TEST_CASE("Collapses keep locked vertices, and the components connected through them") {
    const Patch grid = wavy_grid(30, 0.3);
    std::vector<bool> locked(grid.positions.size());
    std::mt19937 random(4);
    std::generate(locked.begin(), locked.end(), [&] { return random() % 5 == 0; });
    CornerMesh mesh(grid.positions.size(), grid.triangles, locked);
    EdgeQueue queue(grid.positions, mesh, 1e4F);
    StarCollapse collapse(grid.positions, grid.box, grid.shared, locked, mesh);
    collapse_stars(
        queue, collapse, waiting_vertices(grid.triangles, grid.tried, locked), locked,
        [&](const EdgeQueue::Edge& edge) {
            return collapse.look(edge.from, edge.to) && collapse.has_no_new_fold(-1) ? 0 : kNever;
        },
        [&] {
            const std::uint32_t fewer = collapse.fewer();
            collapse.take();
            return fewer;
        });
    std::vector<PatchTriangle> left;
    for (std::uint32_t t = 0; t < grid.triangles.size(); ++t) {
        if (!mesh.is_gone(t)) {
            left.push_back(mesh.corners(t));
        }
    }
    REQUIRE(left.size() < grid.triangles.size());
    std::vector<bool> used(locked.size());
    for (const PatchTriangle& t : left) {
        for (const std::uint32_t v : t) {
            used[v] = true;
        }
    }
    for (std::size_t v = 0; v < locked.size(); ++v) {
        REQUIRE((!locked[v] || used[v]));
    }
}

TEST_CASE("The minimum of the quadric error is not worse than positions around it") {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> number(-1, 1);
    const auto point = [&] { return Double3{number(random), number(random), number(random)}; };
    REQUIRE_FALSE(Quadric().lowest({1, 2, 3}));
    for (int i = 0; i < 200; ++i) {
        Quadric quadric;
        for (int plane = 0; plane <= i % 5; ++plane) {
            Double3 n = point();
            const double size = length(n);
            n = {n[0] / size, n[1] / size, n[2] / size};
            quadric.add_plane(n, point(), 1 + number(random));
        }
        const Double3 near = point();
        const std::optional<Double3> lowest = quadric.lowest(near);
        REQUIRE(lowest);
        const auto cost = [&](const Double3& p) {
            return quadric.mean(p) + 0.01 * square(minus(p, near));
        };
        for (int k = 0; k < 20; ++k) {
            REQUIRE(cost(*lowest) <= cost(along(*lowest, k < 10 ? 0.01 : 0.5, point())) + 1e-12);
        }
    }
}

TEST_CASE("A collapse to another position considers the triangles and folds that it makes") {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> share(-1, 1);
    int looked = 0;
    int folded = 0;
    for (int i = 0; i < 3000; ++i) {
        const Patch patch = torus(9, 7, 4, 1.5, 0.3);
        std::vector<bool> locked(patch.positions.size());
        CornerMesh mesh(patch.positions.size(), patch.triangles, locked);
        StarCollapse half(patch.positions, patch.box, patch.shared, locked, mesh);
        PlacedCollapse placed(patch.positions, patch.box, patch.shared, mesh);
        const PatchTriangle& t = patch.triangles[random() % patch.triangles.size()];
        if (!half.look(t[0], t[1])) {
            continue;
        }
        const auto& p = patch.positions[t[1]];
        const auto moved = [&](float x) { return x + static_cast<float>(share(random)); };
        const std::array<float, 3> place{moved(p[0]), moved(p[1]), moved(p[2])};
        if (!placed.look(half, place)) {
            continue;
        }
        ++looked;
        // Compares the whole mesh before and after: its sharpest edges at changed triangles.
        const auto sharpest = [&](const std::vector<std::array<float, 3>>& positions,
                                  const std::vector<PatchTriangle>& triangles, std::uint32_t end) {
            const auto normal = [&](const PatchTriangle& c) {
                const Triangle at = triangle_at(positions, c);
                return StarCollapse::normal(at[0], at[1], at[2]);
            };
            const auto has = [&](const PatchTriangle& c, std::uint32_t v) {
                return c[0] == v || c[1] == v || c[2] == v;
            };
            float least = 1;
            for (const PatchTriangle& a : triangles) {
                if (!has(a, t[1]) && !has(a, end)) {
                    continue;
                }
                for (const PatchTriangle& b : triangles) {
                    const auto common = std::count_if(a.begin(), a.end(),
                                                      [&](std::uint32_t v) { return has(b, v); });
                    if (common == 2) {
                        least = std::min(least, StarCollapse::cosine(normal(a), normal(b)));
                    }
                }
            }
            return least;
        };
        std::vector<std::array<float, 3>> positions = patch.positions;
        positions[t[1]] = place;
        std::vector<PatchTriangle> after;
        for (PatchTriangle c : patch.triangles) {
            std::replace(c.begin(), c.end(), t[0], t[1]);
            if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]) {
                after.push_back(c);
            }
        }
        REQUIRE(after.size() + 2 == patch.triangles.size());
        REQUIRE(placed.after().size() + 2 == placed.before().size());
        for (const PlacedCollapse::Placed& one : placed.after()) {
            REQUIRE(one.at == triangle_at(positions, one.corners));
            REQUIRE(std::any_of(after.begin(), after.end(), [&](const PatchTriangle& c) {
                return from_smallest(c) == from_smallest(one.corners);
            }));
        }
        const float before_fold = sharpest(patch.positions, patch.triangles, t[0]);
        const float after_fold = sharpest(positions, after, t[1]);
        for (const float least : {0.7F, 0.0F, -0.5F}) {
            const bool is_fine = after_fold >= least || after_fold >= before_fold;
            REQUIRE(placed.has_no_new_fold(half, least) == is_fine);
            folded += is_fine ? 0 : 1;
        }
    }
    REQUIRE(looked > 300);
    REQUIRE(folded > 100);
}
