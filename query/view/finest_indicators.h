// The indicators of level 1's faces and edges, from the values of one cube of edge 2.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 4 and 5. At the finest scale an indicator
// depends on no finer one, so whoever has the 27 values of a cube has them all; the store keeps
// only the cube's centre (store/FORMAT.md, section 4).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "query/view/topology.h"
#include "store/base/box.h"
#include "store/base/outward.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Values of the nodes {0, 1, 2}^3 of a cube, numbered x + 3 y + 9 z, the all-even corner at 0.
using CubeValues = std::array<double, 27>;

/// The values of cube `cube` of level 1 from a box that covers it, mirrored so that the all-even
/// corner is 0.
template <class T>
CubeValues cube_values(const Box<T>& values, const Int3& cube) {
    const unsigned mirror = mirror_of(cube);
    CubeValues u{};
    for (int p = 0; p < 27; ++p) {
        u[static_cast<std::size_t>(p)] =
            static_cast<double>(values.at(cube * 2 + node_offset(p, mirror)));
    }
    return u;
}

namespace finest {

/// The position with every coordinate that is 1 replaced by `by` (0 or 2): the two ends of the
/// refinement edge, in a cube whose all-even corner is 0.
constexpr int end_of(int position, int by) {
    int out = 0;
    for (int power = 1; power <= 9; power *= 3) {
        const int c = position / power % 3;
        out += power * (c == 1 ? by : c);
    }
    return out;
}

struct Node {
    std::uint8_t low = 0;
    std::uint8_t high = 0;
    std::uint8_t odd = 0;
    std::array<std::uint8_t, 6> children{};  ///< 2 odd of them: faces of a cube, edges of a face
};

constexpr std::array<Node, 27> make_nodes() {
    std::array<Node, 27> nodes{};
    for (int p = 0; p < 27; ++p) {
        Node& node = nodes[static_cast<std::size_t>(p)];
        node.low = static_cast<std::uint8_t>(end_of(p, 0));
        node.high = static_cast<std::uint8_t>(end_of(p, 2));
        for (int power = 1; power <= 9; power *= 3) {
            if (p / power % 3 == 1) {
                node.children[2U * node.odd] = static_cast<std::uint8_t>(p - power);
                node.children[2U * node.odd + 1U] = static_cast<std::uint8_t>(p + power);
                ++node.odd;
            }
        }
    }
    return nodes;
}
inline constexpr std::array<Node, 27> kNodes = make_nodes();

}  // namespace finest

/// The position of a cube's node of this slot.
constexpr int position_of_slot(int slot) {
    const Int3 o = slot_offset(slot);
    return static_cast<int>(o.x + 3 * o.y + 9 * o.z);
}

/// eta of a node with value `u` between the ends of its refinement edge: +inf if any is missing.
/// `outward`: StoreLayout::rounds_outward().
inline double finest_offset(double u, double end0, double end1, bool outward) {
    const double eta = outward ? outward_offset(u, end0, end1) : std::fabs(u - 0.5 * (end0 + end1));
    return eta <= std::numeric_limits<double>::max() ? eta
                                                     : std::numeric_limits<double>::infinity();
}
inline double finest_offset(const CubeValues& u, int position, bool outward) {
    const auto& node = finest::kNodes[static_cast<std::size_t>(position)];
    return finest_offset(u[static_cast<std::size_t>(position)], u[node.low], u[node.high], outward);
}

/// linf_bar (which is deviation_bar at level 1), or linf_plus, of an edge midpoint, a face centre
/// or the cube's centre. REQUIRES: position is odd in at least one coordinate.
inline double finest_indicator(const CubeValues& u, int position, bool plus, bool outward) {
    const auto& node = finest::kNodes[static_cast<std::size_t>(position)];
    const double eta = finest_offset(u, position, outward);
    if (node.odd == 1) {
        return eta;
    }
    double largest = 0;
    for (std::size_t i = 0; i < 2U * node.odd; ++i) {
        largest = std::max(largest, finest_indicator(u, node.children[i], plus, outward));
    }
    return plus ? eta + largest : std::max(eta, largest);
}

}  // namespace isonest::detail
