// The nested grid in closed form: levels, nodes, refinement edges, children.
//
// Source: T. Gerstner, M. Rumpf, U. Weikard, "Error Indicators for Multilevel Visualization and
// Computing on Nested Grids", Computers & Graphics 24 (2000), section 2; the reflected Kuhn
// subdivision is Maubach's (SIAM J. Sci. Comput. 16, 1995). No element is ever stored.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// Largest number of nodes per axis. Doubled coordinates of three axes then fit in one 64-bit key.
inline constexpr std::int64_t kMaxNodesPerAxis = std::int64_t{1} << 20;

/// The levels of a volume. Level L is the lattice of stride 2^L. Its cubes tile the volume, so the
/// last node of an axis may lie outside, where it has the value of the nearest node of the volume.
class Lattice {
  public:
    Lattice() = default;
    /// REQUIRES: 1 <= nodes[axis] <= kMaxNodesPerAxis.
    explicit Lattice(const Int3& nodes);

    [[nodiscard]] const Int3& nodes() const { return nodes_; }
    /// The coarsest level: the lowest one with at most one cube along every axis.
    [[nodiscard]] int top() const { return top_; }
    /// Cubes of edge 2^level per axis; 0 along an axis that has a single node.
    [[nodiscard]] Int3 cells_at(int level) const;
    /// Nodes of the lattice of stride 2^level per axis (cells + 1).
    [[nodiscard]] Int3 nodes_at(int level) const;
    /// Axes with a single node (bits x, y, z). If there are any, the grid consists of triangles or
    /// edges.
    [[nodiscard]] unsigned flat_axes() const;
    /// 3 minus the number of flat axes.
    [[nodiscard]] int dimension() const;
    /// Number of elements with a centre at a level: cubes, squares or edges; equals cells_at()
    /// except 1 along a flat axis.
    [[nodiscard]] Int3 elements_at(int level) const;
    /// The centre of an element, as a node of the finest lattice. REQUIRES: level > 0.
    [[nodiscard]] Int3 centre_of(int level, const Int3& element) const {
        const Int3 half{nodes_.x > 1 ? 1 : 0, nodes_.y > 1 ? 1 : 0, nodes_.z > 1 ? 1 : 0};
        return (element * 2 + half) * (std::int64_t{1} << (level - 1));
    }
    /// The slot of those centres: kCentreSlot unless an axis is flat. REQUIRES: dimension() > 0.
    [[nodiscard]] int centre_slot() const;

  private:
    Int3 nodes_{1, 1, 1};
    int top_ = 0;
};

/// What a node refines: the number of its odd coordinates after division by its scale.
enum class NodeKind : std::uint8_t { macro_vertex = 0, edge = 1, face = 2, centre = 3 };

/// The closed-form description of one node.
struct NodeInfo {
    NodeKind kind = NodeKind::macro_vertex;
    /// Largest power of two that divides all coordinates; 0 for macro vertices.
    std::int64_t scale = 0;
    std::array<bool, 3> odd{};
    Int3 end0;  ///< end of the refinement edge with lattice coordinates x - s*sigma
    Int3 end1;  ///< the other end, x + s*sigma

    /// The level whose refinement node it is: scale 2^(level - 1). REQUIRES: scale > 0.
    [[nodiscard]] int level() const {
        return std::countr_zero(static_cast<std::uint64_t>(scale)) + 1;
    }
};

/// The coarsest level that contains the node, regardless of a store's top; 0 for the origin.
inline int level_of_node(const Int3& node) {
    const auto bits = static_cast<std::uint64_t>(node.x | node.y | node.z);
    return bits == 0 ? 0 : std::countr_zero(bits);
}

/// Describes node x of a lattice whose coarsest cubes have edge 2^top.
/// REQUIRES: x >= 0.
NodeInfo describe_node(const Int3& x, int top);

/// The seven refinement nodes of scale 2^(L-1) that belong to a node of level L: slot = ox + 2 oy +
/// 4 oz - 1 for the offset (ox, oy, oz) in {0,1}^3 \ 0 times the scale. Slots 0, 1, 3 are the
/// midpoints of the cube's edges along x, y, z; 2, 4, 5 the centres of its xy, xz, yz faces; 6 its
/// centre. Along a flat axis all nodes have offset 0, and the centre of a square or an edge takes
/// the place of the cube's centre.
inline constexpr int kSlots = 7;
inline constexpr int kCentreSlot = 6;
constexpr int slot_of(int ox, int oy, int oz) {
    return ox + 2 * oy + 4 * oz - 1;
}
/// The slot of node p, in units of the nodes' scale. REQUIRES: p >= 0, at least one coordinate odd.
constexpr int slot_of(const Int3& p) {
    return slot_of(static_cast<int>(p.x & 1), static_cast<int>(p.y & 1), static_cast<int>(p.z & 1));
}
constexpr Int3 slot_offset(int slot) {
    return {(slot + 1) & 1, ((slot + 1) >> 1) & 1, ((slot + 1) >> 2) & 1};
}

}  // namespace isonest::detail
