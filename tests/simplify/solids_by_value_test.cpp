// Closed surfaces and missing data: surfaces that are simplified within an error of the values.
#include "tests/simplify/mesh_by_value.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

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
