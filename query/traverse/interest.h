// The interest test: whether the finest function can take the isovalue in a tetrahedron.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5, beta_0: |U - U^l| <= beta in the tetrahedron,
// so U stays within the values of its vertices plus or minus beta. Here beta is the saturated
// deviation (or eta_plus), not the eta_plus / 2 that the paper prints and that is not a bound.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include <isonest/field.h>
#include <isonest/world.h>

#include "query/view/finest_indicators.h"
#include "query/view/topology.h"
#include "store/base/hypot3.h"

namespace isonest::detail {

/// Whether what is between `low` and `high`, or up to beta beyond, can be the isovalue. Missing
/// values, where beta is infinite, never exclude anything.
inline bool may_reach(double low, double high, double beta, double iso) {
    return !(low - beta > iso) && !(high + beta < iso);
}

/// Whether an element at a closed face of the box can have a share in the cap there: what is
/// between `low` and `high`, or up to beta beyond, need not all be like the outside.
inline bool may_be_solid(double low, double high, double beta, double iso, Outside outside) {
    return outside == Outside::below ? !(high + beta < iso) : !(low - beta > iso);
}

/// By what the bound field at the refinement node of an element has to be multiplied to bound
/// |U - U^l| there: 1, and h(T) for the gradient type (section 5 of the paper). The element is in a
/// cube of edge 2^level.
inline double bound_scale(Field bound, int level, const Double3& spacing) {
    if (indicator_of(bound) != Indicator::grad_linf) {
        return 1;
    }
    // U - U^l is 0 in an element's vertices, and changes by at most the gradient's bound along the
    // way to any other point; none is further than the longest edge of the element's box.
    return std::ldexp(hypot3(spacing[0], spacing[1], spacing[2]), level);
}

/// Smallest and largest value in a tetrahedron's vertices.
inline std::pair<double, double> range_of(const CubeValues& value, const TopologyTetrahedron& t) {
    double low = value[t.vertices[0]];
    double high = low;
    for (std::size_t i = 1; i < 4; ++i) {
        low = std::min(low, value[t.vertices[i]]);
        high = std::max(high, value[t.vertices[i]]);
    }
    return {low, high};
}

/// In several of the 27 nodes (bits).
inline std::pair<double, double> range_of(const CubeValues& value, std::uint32_t nodes) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (; nodes != 0; nodes &= nodes - 1) {
        const double v = value[static_cast<std::size_t>(std::countr_zero(nodes))];
        low = std::min(low, v);
        high = std::max(high, v);
    }
    return {low, high};
}

/// By the tetrahedron's own vertices and bound.
inline bool may_cross(const CubeValues& value, const TopologyTetrahedron& t, double beta,
                      double iso) {
    const auto [low, high] = range_of(value, t);
    return may_reach(low, high, beta, iso);
}

/// The same of several tetrahedra with one bound and a diagonal in common, `nodes` being the bits
/// of all their vertices. One of them may cross if and only if all together may: where none does,
/// each is wholly on one side, and the diagonal says that it is the same.
inline bool may_cross_any(const CubeValues& value, std::uint32_t nodes, double beta, double iso) {
    const auto [low, high] = range_of(value, nodes);
    return may_reach(low, high, beta, iso);
}

/// What the 27 values of a cube and the bounds of its eight subcubes say about the finest function:
/// in a subcube it stays within the values of the corners plus or minus the bound of the centre. So
/// a tetrahedron none of whose nodes can be below the isovalue, or none not below it, holds none of
/// the surface. Sharper than the tetrahedron's own bound, which looks at the coarser function; with
/// bounds of 0, at the finest level, exact.
struct Sides {
    // Bit p: near node position p the function may be below the isovalue, or not below it.
    std::uint32_t below = 0;
    std::uint32_t not_below = 0;

    /// `nodes`: bits of node positions.
    [[nodiscard]] bool both_in(std::uint32_t nodes) const {
        return (nodes & below) != 0 && (nodes & not_below) != 0;
    }
    [[nodiscard]] bool both_in(const TopologyTetrahedron& t) const { return both_in(t.nodes); }
    /// Of an element at a closed face of the box: what is beyond counts.
    [[nodiscard]] Sides with(Outside outside) const {
        return outside == Outside::below ? Sides{~0U, not_below} : Sides{below, ~0U};
    }
};

namespace interest {

/// The node positions (x + 3 y + 9 z) of the eight subcubes' corners.
constexpr std::array<std::array<std::uint8_t, 8>, 8> make_corners() {
    std::array<std::array<std::uint8_t, 8>, 8> corners{};
    for (unsigned cube = 0; cube < 8; ++cube) {
        for (unsigned c = 0; c < 8; ++c) {
            const unsigned x = (cube & 1U) + (c & 1U);
            const unsigned y = (cube >> 1U & 1U) + (c >> 1U & 1U);
            const unsigned z = (cube >> 2U) + (c >> 2U);
            corners[cube][c] = static_cast<std::uint8_t>(x + 3 * y + 9 * z);
        }
    }
    return corners;
}
inline constexpr auto kCorners = make_corners();

}  // namespace interest

/// Without bounds, as at the finest level. Missing values are on neither side.
inline Sides sides_of(const CubeValues& value, double iso) {
    Sides sides;
    for (std::size_t p = 0; p < value.size(); ++p) {
        sides.below |= (value[p] < iso ? 1U : 0U) << p;
        sides.not_below |= (value[p] >= iso ? 1U : 0U) << p;
    }
    return sides;
}

/// Bits of the node positions whose value is the isovalue or missing.
inline std::uint32_t special_nodes(const CubeValues& value, double iso) {
    std::uint32_t special = 0;
    for (std::size_t p = 0; p < value.size(); ++p) {
        special |= (value[p] == iso || !std::isfinite(value[p]) ? 1U : 0U) << p;
    }
    return special;
}

/// `bound` of the subcubes (bits x, y, z). Missing values: where a bound is infinite nothing is
/// excluded; with bounds of 0 they are on neither side.
inline Sides sides_of(const CubeValues& value, const std::array<double, 8>& bound, double iso) {
    std::array<double, 27> around{};
    for (std::size_t cube = 0; cube < 8; ++cube) {
        for (const std::uint8_t p : interest::kCorners[cube]) {
            around[p] = std::max(around[p], bound[cube]);
        }
    }
    Sides sides;
    for (std::size_t p = 0; p < 27; ++p) {
        const double low = value[p] - around[p];
        const double high = value[p] + around[p];
        const bool unknown = around[p] > std::numeric_limits<double>::max();
        // A difference that was rounded may be the isovalue, and the function yet below it.
        const bool below = unknown || low < iso || (around[p] > 0 && low == iso);
        const bool not_below = unknown || high >= iso;
        sides.below |= (below ? 1U : 0U) << p;
        sides.not_below |= (not_below ? 1U : 0U) << p;
    }
    return sides;
}

}  // namespace isonest::detail
