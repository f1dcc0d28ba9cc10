// Single collapses: displacements compared with individually mapped points, corner meshes with
// newly made ones, and which collapses are refused.
#include <catch2/catch.hpp>
#include <cmath>
#include <optional>
#include <random>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/star_mapping.h"
#include "tests/support/surface_samples.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

Star star_of(const std::vector<Double3>& ring) {
    Star star;
    star.corners = ring.size();
    std::copy(ring.begin(), ring.end(), star.ring.begin());
    return star;
}

std::size_t next_in(const Star& star, std::size_t i) {
    return (i + 1) % star.corners;
}

Triangle old_triangle(const Star& star, std::size_t i) {
    return {Double3{0, 0, 0}, star.ring[i], star.ring[next_in(star, i)]};
}

Triangle new_triangle(const Star& star, std::size_t j) {
    return {star.ring[0], star.ring[j], star.ring[j + 1]};
}

/// The direction of projection of the overlay: the ring's vector area; at a border, in the border's
/// plane.
Double3 looks_along(const Star& star) {
    Double3 up{};
    for (std::size_t i = 0; i < star.corners; ++i) {
        up = along(up, 1, cross(star.ring[i], star.ring[next_in(star, i)]));
    }
    if (star.is_straight) {
        const Double3 line = minus(star.ring[next_in(star, star.missing)], star.ring[star.missing]);
        up = along(up, -dot(up, line) / square(line), line);
    } else if (star.missing != Star::kNone) {
        up[star.axis] = 0;
    }
    const double size = std::sqrt(square(up));
    return {up[0] / size, up[1] / size, up[2] / size};
}

/// The distance along `up` of the plane of a triangle from `p`, if the triangle is above or below
/// it, up to `slack` of its size.
std::optional<double> height_to(const Triangle& t, const Double3& p, const Double3& up,
                                double slack) {
    const Double3 n = cross(minus(t[1], t[0]), minus(t[2], t[0]));
    const double by = dot(n, up);
    if (std::fabs(by) < 1e-12) {
        return std::nullopt;
    }
    const double h = dot(n, minus(t[0], p)) / by;
    const Double3 q = along(p, h, up);
    for (std::size_t i = 0; i < 3; ++i) {
        const Double3 side = cross(minus(t[(i + 1) % 3], t[i]), minus(q, t[i]));
        if (dot(side, n) < -slack * square(n)) {
            return std::nullopt;
        }
    }
    return h;
}

/// A ring around the origin with heights up to `height`.
Star random_star(std::mt19937& random, std::size_t corners, double height) {
    std::uniform_real_distribution<double> number(0, 1);
    constexpr double kTurn = 6.283185307179586;
    std::vector<Double3> ring;
    for (std::size_t i = 0; i < corners; ++i) {
        const double angle =
            kTurn * (static_cast<double>(i) + 0.8 * number(random)) / static_cast<double>(corners);
        const double far = 0.5 + number(random);
        ring.push_back(
            {far * std::cos(angle), far * std::sin(angle), height * (2 * number(random) - 1)});
    }
    return star_of(ring);
}

/// The same with a border through the middle, in a plane perpendicular to x: the missing old
/// triangle is the first or the last one.
Star random_border_star(std::mt19937& random, std::size_t corners, double height, bool first) {
    Star star = random_star(random, corners, height);
    std::uniform_real_distribution<double> number(0, 1);
    constexpr double kHalf = 3.141592653589793;
    for (std::size_t i = 0; i < corners; ++i) {
        // From one end of the border, at -90 degrees, to the other.
        const double share = static_cast<double>(i) / static_cast<double>(corners - 1);
        const double angle = kHalf * (share - 0.5);
        const double far = 0.5 + number(random);
        star.ring[i] = {far * std::cos(angle), far * std::sin(angle), star.ring[i][2]};
    }
    star.ring[0][0] = star.ring[corners - 1][0] = 0;
    star.axis = 0;
    star.missing = corners - 1;
    if (first) {
        std::rotate(star.ring.begin(), star.ring.begin() + static_cast<long>(corners) - 1,
                    star.ring.begin() + static_cast<long>(corners));
        star.missing = 0;
    }
    return star;
}

/// With a border that passes straight through the middle, in any direction.
Star random_straight_star(std::mt19937& random, std::size_t corners, double height, bool first) {
    Star star = random_border_star(random, corners, height, first);
    Double3& from = star.ring[star.missing];
    const Double3 to = star.ring[next_in(star, star.missing)];
    from = {-0.7 * to[0], -0.7 * to[1], -0.7 * to[2]};
    star.axis = Star::kNone;
    star.is_straight = true;
    std::uniform_real_distribution<double> turn(0, 6.283185307179586);
    for (std::size_t a = 0; a < 3; ++a) {
        const double c = std::cos(turn(random));
        const double s = std::sqrt(1 - c * c);
        const std::size_t b = (a + 1) % 3;
        for (std::size_t i = 0; i < corners; ++i) {
            Double3& p = star.ring[i];
            const double x = c * p[a] - s * p[b];
            p[b] = s * p[a] + c * p[b];
            p[a] = x;
        }
    }
    return star;
}

Displacement random_displacement(std::mt19937& random, double size) {
    std::uniform_real_distribution<double> number(-size, size);
    Displacement d;
    for (std::size_t a = 0; a < 3; ++a) {
        const double x = number(random);
        const double y = number(random);
        d.lo[a] = static_cast<float>(std::min(x, y));
        d.hi[a] = static_cast<float>(std::max(x, y));
    }
    d.radius = static_cast<float>(std::fabs(number(random)));
    return d;
}

struct Overlaid {
    std::vector<Displacement> before;
    std::array<Displacement, Star::kMaxCorners> after;
};

bool overlay(const Star& star, Overlaid& o, double limit) {
    FanOverlay overlay;
    if (!overlay.look_at(star)) {
        return false;
    }
    std::vector<const Displacement*> pointers;
    for (std::size_t i = 0; i < star.corners; ++i) {
        pointers.push_back(i == star.missing ? nullptr : &o.before[i]);
    }
    if (!overlay.crosses()) {
        return false;
    }
    bool is_within = true;
    for (std::size_t j = 1; j + 1 < star.corners; ++j) {
        o.after[j] = overlay.displacement(j, pointers);
        is_within = is_within && o.after[j].bound() <= limit;
    }
    return is_within;
}

void require_all_displacements(std::mt19937& random, const Star& star) {
    Overlaid o;
    for (std::size_t i = 0; i < star.corners; ++i) {
        o.before.push_back(random_displacement(random, 0.2));
    }
    REQUIRE(overlay(star, o, 1e9));
    const Double3 up = looks_along(star);
    constexpr int kSteps = 40;
    double most = 0;
    for (std::size_t j = 1; j + 1 < star.corners; ++j) {
        const Displacement& d = o.after[j];
        std::array<double, 3> lo{1e9, 1e9, 1e9};
        std::array<double, 3> hi{-1e9, -1e9, -1e9};
        double spread = 0;
        const Triangle t = new_triangle(star, j);
        const Double3 middle = along({0, 0, 0}, 1.0 / 3, along(along(t[0], 1, t[1]), 1, t[2]));
        for_samples(t, kSteps, [&](const Double3& sample) {
            // Touching does not count as overlap.
            const Double3 p = along(middle, 0.999, minus(sample, middle));
            int found = 0;
            for (std::size_t i = 0; i < star.corners; ++i) {
                if (i == star.missing) {
                    continue;
                }
                const auto h = height_to(old_triangle(star, i), p, up, 1e-9);
                if (!h) {
                    continue;
                }
                ++found;
                spread = std::max(spread, std::fabs(*h));
                for (std::size_t a = 0; a < 3; ++a) {
                    // From the old triangle to the new one.
                    const double moved = -*h * up[a];
                    lo[a] = std::min(lo[a], moved + static_cast<double>(o.before[i].lo[a]));
                    hi[a] = std::max(hi[a], moved + static_cast<double>(o.before[i].hi[a]));
                }
                REQUIRE(d.radius >= o.before[i].radius);
            }
            REQUIRE(found > 0);
        });
        for (std::size_t a = 0; a < 3; ++a) {
            REQUIRE(static_cast<double>(d.lo[a]) <= lo[a] + 1e-9);
            REQUIRE(static_cast<double>(d.hi[a]) >= hi[a] - 1e-9);
            // The box contains the extremes, which lie between samples; old triangles smaller than
            // the distance between samples may be missed.
            REQUIRE(static_cast<double>(d.lo[a]) >= lo[a] - 0.4 - spread);
            REQUIRE(static_cast<double>(d.hi[a]) <= hi[a] + 0.4 + spread);
        }
        most = std::max(most, d.bound());
    }
    REQUIRE(overlay(star, o, most));
    REQUIRE_FALSE(overlay(star, o, most * (1 - 1e-6)));
}

std::vector<bool> none_locked(const Patch& patch) {
    return std::vector<bool>(patch.positions.size());
}

std::vector<PatchTriangle> triangles_of(const CornerMesh& mesh) {
    std::vector<PatchTriangle> left;
    for (std::uint32_t t = 0; t < mesh.triangles(); ++t) {
        if (!mesh.is_gone(t)) {
            left.push_back(from_smallest(mesh.corners(t)));
        }
    }
    return left;
}

}  // namespace

TEST_CASE("Displacements of a collapse contain those of all points, also at borders") {
    std::mt19937 random(11);
    std::array<int, 2> looked{};
    for (int round = 0; round < 150; ++round) {
        const std::size_t corners = 3 + static_cast<std::size_t>(round) % 8;
        const double height = round % 3 == 0 ? 0.05 : 0.5;
        Star star = random_star(random, corners, height);
        if (round % 3 != 0) {
            star = random_border_star(random, corners, height, round % 3 == 1);
        }
        for (const Star& one :
             {star, random_straight_star(random, corners, height, round % 2 == 0)}) {
            FanOverlay overlay;
            if (overlay.look_at(one)) {
                ++looked[one.is_straight ? 1 : 0];
                require_all_displacements(random, one);
            }
        }
    }
    REQUIRE(looked[0] > 60);
    REQUIRE(looked[1] > 60);
}

TEST_CASE("A vertex on a spoke of the fan is on both sides of it") {
    std::mt19937 random(12);
    // The middle lies on the line from the first corner to the opposite one.
    Star star = star_of({{-1, 0, 0.1}, {0, -1, 0.2}, {1, 0, -0.3}, {0, 1, 0.05}});
    require_all_displacements(random, star);
    star = star_of({{-1, 0, 0.1},
                    {-0.5, -1, 0.2},
                    {0.5, -1, 0},
                    {1, 0, -0.3},
                    {0.5, 1, 0.05},
                    {-0.5, 1, -0.05}});
    require_all_displacements(random, star);
}

TEST_CASE("Rings that overlap themselves, wind twice or have slivers are refused") {
    FanOverlay overlay;
    const std::vector<Double3> square{{1, 1, 0}, {-1, 1, 0.1}, {-1, -1, 0}, {1, -1, 0.2}};
    REQUIRE(overlay.look_at(star_of(square)));
    std::vector<Double3> twice = square;
    twice.insert(twice.end(), square.begin(), square.end());
    REQUIRE_FALSE(overlay.look_at(star_of(twice)));
    // A spiral: each edge turns left, 8 times by a quarter.
    for (std::size_t i = 0; i < twice.size(); ++i) {
        const double far = 1 + 0.1 * static_cast<double>(i);
        twice[i] = {far * twice[i][0], far * twice[i][1], 0.1 * static_cast<double>(i)};
    }
    REQUIRE_FALSE(overlay.look_at(star_of(twice)));
    // Folded back over itself.
    REQUIRE_FALSE(overlay.look_at(
        star_of({{1, 1, 0}, {-1, 1, 0}, {0, 1.2, 0}, {-1.2, 0.5, 0}, {-1, -1, 0}, {1, -1, 0}})));
    // Not entirely visible from the first corner.
    REQUIRE_FALSE(overlay.look_at(
        star_of({{3, 0, 0}, {0.1, 0.2, 0}, {0, 3, 0}, {-1, -1, 0}, {0.2, -0.2, 0}})));
    // The middle is on an edge, at a corner, and outside.
    REQUIRE_FALSE(overlay.look_at(star_of({{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}})));
    REQUIRE_FALSE(overlay.look_at(star_of({{0, 0, 0}, {0, 1, 0}, {-1, -1, 0}, {1, -1, 0}})));
    REQUIRE_FALSE(overlay.look_at(star_of({{1, 1, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 0}})));
    // Two corners at the same position, and at almost the same.
    REQUIRE_FALSE(
        overlay.look_at(star_of({{1, 1, 0}, {-1, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {1, -1, 0}})));
    REQUIRE_FALSE(overlay.look_at(
        star_of({{1, 1, 0}, {-1, 1, 0}, {-1, 1 - 1e-9, 0}, {-1, -1, 0}, {1, -1, 0}})));
    // No area at all.
    REQUIRE_FALSE(overlay.look_at(star_of({{1, 0, 0}, {1, 0, 0}, {1, 0, 0}})));
    REQUIRE_FALSE(overlay.look_at(star_of({{0, 0, 0}, {0, 0, 0}, {0, 0, 0}})));
    // A border that is not straight as seen from above, or does not pass through the middle.
    Star border = star_of({{0, -1, 0}, {1, -1, 0}, {1, 1, 0}, {0, 1, 0.3}});
    border.missing = 3;
    border.axis = 0;
    REQUIRE(overlay.look_at(border));
    border.ring[3][0] = 0.01;
    REQUIRE_FALSE(overlay.look_at(border));
    border.ring[3] = {0, -2, 0};
    REQUIRE_FALSE(overlay.look_at(border));
}

TEST_CASE("Updated corner meshes are the same as newly made ones") {
    std::mt19937 random(13);
    Patch patch = torus(14, 9, 3, 1, 0.1);
    append(patch, wavy_grid(9, 0.2), {10, 0, 0});
    append(patch, torus(3, 3, 3, 1, 0), {20, 0, 0});
    std::vector<bool> locked = none_locked(patch);
    for (std::uint32_t v = 0; v < locked.size(); ++v) {
        locked[v] = v % 17 == 0;
    }
    CornerMesh mesh(patch.positions.size(), patch.triangles, locked);
    const Shape shape = shape_of(patch.triangles);
    CornerMesh::Ring ring;
    int made = 0;
    for (int round = 0; round < 4000; ++round) {
        const auto v = static_cast<std::uint32_t>(random() % patch.positions.size());
        mesh.ring_of(v, ring);
        if (locked[v] || ring.vertices.empty()) {
            continue;
        }
        const std::size_t place = random() % ring.vertices.size();
        const std::uint32_t to = ring.vertices[place];
        const bool is_end = place == 0 || place + 1 == ring.vertices.size();
        if (!mesh.keeps_topology(ring, place, locked)) {
            continue;
        }
        REQUIRE((ring.is_closed || is_end));
        mesh.collapse(ring, place);
        ++made;
        const std::vector<PatchTriangle> left = triangles_of(mesh);
        REQUIRE(shape_of(left) == shape);
        std::vector<bool> same = locked;
        const CornerMesh anew(patch.positions.size(), left, same);
        REQUIRE(same == locked);
        REQUIRE(mesh.first(v) == CornerMesh::kNone);
        for (std::uint32_t w = 0; w < patch.positions.size(); ++w) {
            CornerMesh::Ring is;
            CornerMesh::Ring would_be;
            mesh.ring_of(w, is);
            anew.ring_of(w, would_be);
            REQUIRE(is.is_closed == would_be.is_closed);
            REQUIRE(is.vertices.size() == would_be.vertices.size());
            if (!is.vertices.empty() && is.is_closed) {
                const auto begin = std::find(would_be.vertices.begin(), would_be.vertices.end(),
                                             is.vertices.front());
                std::rotate(would_be.vertices.begin(), begin, would_be.vertices.end());
            }
            REQUIRE(is.vertices == would_be.vertices);
        }
        mesh.ring_of(to, ring);
        REQUIRE(ring.vertices.size() >= 2);
    }
    REQUIRE(made > 100);
}

TEST_CASE("Collapses that would change the topology, or what other patches share, are refused") {
    const auto allowed = [](std::size_t vertices, const std::vector<PatchTriangle>& triangles,
                            std::uint32_t from, std::uint32_t to, std::vector<bool> locked) {
        locked.resize(vertices);
        CornerMesh mesh(vertices, triangles, locked);
        CornerMesh::Ring ring;
        mesh.ring_of(from, ring);
        const auto at = std::find(ring.vertices.begin(), ring.vertices.end(), to);
        return !locked[from] && at != ring.vertices.end() &&
               mesh.keeps_topology(ring, static_cast<std::size_t>(at - ring.vertices.begin()),
                                   locked);
    };
    const std::vector<PatchTriangle> tetrahedron{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    REQUIRE_FALSE(allowed(4, tetrahedron, 3, 0, {}));
    REQUIRE_FALSE(allowed(3, {{0, 1, 2}, {0, 2, 1}}, 0, 1, {}));
    REQUIRE_FALSE(allowed(3, {{0, 1, 2}}, 0, 1, {}));
    // A vertex in a square whose corners are shared with other patches.
    const std::vector<PatchTriangle> square{{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}};
    REQUIRE(allowed(5, square, 4, 0, {}));
    REQUIRE_FALSE(allowed(5, square, 4, 0, {true, true, true, true}));
    REQUIRE(allowed(5, square, 4, 0, {true, true, false, true}));
    // In a triangle: other patches could make the same triangle.
    const std::vector<PatchTriangle> three{{0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    REQUIRE_FALSE(allowed(4, three, 3, 0, {true, true, true}));
    REQUIRE(allowed(4, three, 3, 0, {true, true, false}));
    // Vertices with two fans are not moved.
    std::vector<PatchTriangle> fans = square;
    fans.insert(fans.end(), {{0, 5, 6}, {0, 6, 7}});
    REQUIRE_FALSE(allowed(8, fans, 4, 2, {}));
    // Nor are vertices at an edge with three triangles.
    std::vector<PatchTriangle> three_at_edge = square;
    three_at_edge.push_back({0, 4, 5});
    REQUIRE_FALSE(allowed(6, three_at_edge, 4, 2, {}));
}
