// The hierarchy of the tetrahedra of a cube and of its eight subcubes, in a cube whose all-even
// corner is its low corner; other cubes are its mirror images.
#pragma once

#include <array>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// One of the 6 + 12 + 24 tetrahedra between a cube and its subcubes. Node positions are 0, 1 or 2
/// half edges per axis, numbered x + 3 y + 9 z.
struct TopologyTetrahedron {
    std::uint8_t number = 0;  ///< index among all tetrahedra of the tables, below kTopologySize
    std::array<std::uint8_t, 4> vertices{};
    std::uint8_t ref_node = 0;
    /// Kinds 0 and 1: positions of the two children in the next kind's array. Kind 2: the subcube
    /// (bits x, y, z) of each child.
    std::array<std::uint8_t, 2> children{};
    /// Kind 2: which Kuhn tetrahedron of the subcube each child is (position in kAxisOrders).
    std::array<std::uint8_t, 2> child_orders{};
    bool positive = false;  ///< det(v1 - v0, v2 - v0, v3 - v0) > 0
    /// Bit p: node position p is a vertex of the tetrahedron or of one of its descendants in these
    /// tables.
    std::uint32_t nodes = 0;
};

inline constexpr std::size_t kTopologySize = 6 + 12 + 24 + 48;

/// Computed by explicit bisection at first use.
struct Topology {
    std::array<TopologyTetrahedron, 6> cube;   ///< kind 0, in the order of kAxisOrders
    std::array<TopologyTetrahedron, 12> face;  ///< kind 1
    std::array<TopologyTetrahedron, 24> edge;  ///< kind 2
    /// Kind 0 of the eight subcubes (bits x, y, z), in the order of kAxisOrders; no children.
    std::array<std::array<TopologyTetrahedron, 6>, 8> subcube;
    /// Bits of the tetrahedra of each subcube (second index) below each one of kind 1.
    std::array<std::array<std::uint8_t, 8>, 12> below_face{};
    /// The same below each one of kind 0.
    std::array<std::array<std::uint8_t, 8>, 6> below_cube{};
    /// Bits of the node positions that are corners of each subcube.
    std::array<std::uint32_t, 8> corners{};
};
const Topology& topology();

/// The axes (bits x, y, z) along which a cube is a mirror image of the tables' cube.
constexpr unsigned mirror_of(const Int3& cube) {
    return static_cast<unsigned>((cube.x & 1) + 2 * (cube.y & 1) + 4 * (cube.z & 1));
}

/// Whether mirroring along the axes set in `mirror` reverses the orientation.
constexpr bool is_mirror_image(unsigned mirror) {
    return ((mirror ^ (mirror >> 1U) ^ (mirror >> 2U)) & 1U) != 0;
}

/// A corner of a cube of edge 1 from its number (bits x, y, z).
constexpr Int3 corner_offset(unsigned corner) {
    return {corner & 1U, (corner >> 1U) & 1U, (corner >> 2U) & 1U};
}

/// Offsets of the 27 node positions in half edges, for each choice of mirrored axes.
using NodeOffsets = std::array<std::array<Int3, 27>, 8>;
constexpr NodeOffsets make_node_offsets() {
    NodeOffsets offsets{};
    for (unsigned mirror = 0; mirror < offsets.size(); ++mirror) {
        for (std::int64_t position = 0; position < 27; ++position) {
            Int3 o = Int3{3, 3, 3}.unlinear(position);
            for (int axis = 0; axis < 3; ++axis) {
                o[axis] =
                    ((mirror >> static_cast<unsigned>(axis)) & 1U) != 0 ? 2 - o[axis] : o[axis];
            }
            offsets[mirror][static_cast<std::size_t>(position)] = o;
        }
    }
    return offsets;
}
inline constexpr NodeOffsets kNodeOffsets = make_node_offsets();

/// Offset of node `position` in half edges, mirrored along the axes set in `mirror` (bits x, y, z).
constexpr const Int3& node_offset(int position, unsigned mirror) {
    return kNodeOffsets[mirror][static_cast<std::size_t>(position)];
}

}  // namespace isonest::detail
