// The interest test by the values and bounds of the level below, compared with a walk over all
// tetrahedra.
#include "query/traverse/interest.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "query/traverse/bricks/brick_tests.h"

namespace isonest::detail {
namespace {

/// The subcubes' tetrahedra below those of a face: (subcube, tetrahedron) pairs.
std::vector<std::pair<std::size_t, const TopologyTetrahedron*>> below_face(
    const TopologyTetrahedron& face) {
    std::vector<std::pair<std::size_t, const TopologyTetrahedron*>> out;
    for (const std::uint8_t e : face.children) {
        const TopologyTetrahedron& edge = topology().edge[e];
        for (std::size_t i = 0; i < 2; ++i) {
            out.emplace_back(edge.children[i],
                             &topology().subcube[edge.children[i]][edge.child_orders[i]]);
        }
    }
    return out;
}

TEST_CASE(
    "a face's tetrahedron is dropped only if no tetrahedron below it can contain the surface") {
    std::mt19937 random(3);
    std::uniform_int_distribution<int> digit(0, 9);
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    constexpr double kInf = std::numeric_limits<double>::infinity();
    int kept = 0;
    int dropped = 0;
    for (int round = 0; round < 2000; ++round) {
        const bool exact = round % 2 == 0;
        CubeValues value{};
        for (double& v : value) {
            v = digit(random) == 0 && round % 5 == 0 ? kNan : digit(random);
        }
        std::array<double, 8> bound{};
        for (double& b : bound) {
            b = exact ? 0 : digit(random) == 0 ? kInf : digit(random) / 4.0;
        }
        const double iso = digit(random);
        const Sides sides = sides_of(value, bound, iso);
        for (const TopologyTetrahedron& face : topology().face) {
            bool can = false;
            for (const auto& [cube, t] : below_face(face)) {
                bool missing = false;
                double low = kInf;
                double high = -kInf;
                for (const std::uint8_t v : t->vertices) {
                    missing = missing || std::isnan(value[v]);
                    low = std::fmin(low, value[v]);
                    high = std::fmax(high, value[v]);
                }
                if (!missing) {
                    can = can || (low - bound[cube] < iso && high + bound[cube] >= iso);
                } else if (std::isinf(bound[cube])) {
                    can = true;
                }
            }
            const bool both = sides.both_in(face);
            CHECK((both || !can));
            kept += both ? 1 : 0;
            dropped += both ? 0 : 1;
        }
    }
    CHECK(kept > 1000);
    CHECK(dropped > 1000);
}

TEST_CASE("one of a cube's tetrahedra may cross exactly if all of them together may") {
    std::mt19937 random(6);
    std::uniform_int_distribution<int> digit(0, 9);
    std::array<int, 2> found{};
    for (int round = 0; round < 2000; ++round) {
        const bool missing = round % 5 == 0;
        CubeValues value{};
        for (double& v : value) {
            v = missing && digit(random) == 0 ? std::numeric_limits<double>::quiet_NaN()
                                              : digit(random);
        }
        const double bound =
            missing ? std::numeric_limits<double>::infinity() : digit(random) / 4.0;
        const double iso = 2 * digit(random) - 5;
        const auto& tetrahedra = topology().subcube[static_cast<std::size_t>(round % 8)];
        for (unsigned mask = 1; mask < 64; ++mask) {
            bool one = false;
            for (unsigned order = 0; order < 6; ++order) {
                one = one || ((mask >> order & 1U) != 0 &&
                              may_cross(value, tetrahedra[order], bound, iso));
            }
            const std::uint32_t nodes = nodes_of(tetrahedra, static_cast<std::uint8_t>(mask));
            CHECK(may_cross_any(value, nodes, bound, iso) == one);
            ++found[one ? 1 : 0];
        }
    }
    CHECK(std::min(found[0], found[1]) > 1000);
}

TEST_CASE("with bounds of 0 the interest test is exact") {
    std::mt19937 random(4);
    std::uniform_int_distribution<int> digit(0, 9);
    for (int round = 0; round < 500; ++round) {
        CubeValues value{};
        for (double& v : value) {
            v = digit(random);
        }
        const double iso = digit(random);
        const Sides sides = sides_of(value, {}, iso);
        for (const TopologyTetrahedron& edge : topology().edge) {
            bool below = false;
            bool not_below = false;
            for (std::size_t p = 0; p < 27; ++p) {
                if ((edge.nodes >> p & 1U) != 0) {
                    (value[p] < iso ? below : not_below) = true;
                }
            }
            CHECK(sides.both_in(edge) == (below && not_below));
        }
    }
}

TEST_CASE("without bounds the sides are the same as with bounds of 0, also for missing values") {
    std::mt19937 random(5);
    std::uniform_int_distribution<int> digit(0, 9);
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    for (int round = 0; round < 500; ++round) {
        CubeValues value{};
        std::uint32_t special = 0;
        const double iso = digit(random);
        for (std::size_t p = 0; p < 27; ++p) {
            const int d = digit(random);
            value[p] = d == 9   ? std::numeric_limits<double>::quiet_NaN()
                       : d == 8 ? kInfinity
                       : d == 7 ? -kInfinity
                                : d;
            special |= (d >= 7 || d == iso ? 1U : 0U) << p;
        }
        const Sides bounded = sides_of(value, {}, iso);
        const Sides sides = sides_of(value, iso);
        CHECK(sides.below == bounded.below);
        CHECK(sides.not_below == bounded.not_below);
        CHECK(special_nodes(value, iso) == special);
    }
}

TEST_CASE(
    "a tetrahedron's nodes are its vertices and, except for the last kind, its refinement node") {
    const auto bit = [](int p) { return std::uint32_t{1} << static_cast<unsigned>(p); };
    for (const TopologyTetrahedron& edge : topology().edge) {
        std::uint32_t nodes = bit(edge.ref_node);
        for (const std::uint8_t v : edge.vertices) {
            nodes |= bit(v);
        }
        CHECK(edge.nodes == nodes);
    }
    for (const TopologyTetrahedron& face : topology().face) {
        CHECK(face.nodes ==
              (topology().edge[face.children[0]].nodes | topology().edge[face.children[1]].nodes));
    }
}

}  // namespace
}  // namespace isonest::detail
