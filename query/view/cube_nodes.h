// What a brick knows of one cube of the level above while it refines the cube's tetrahedra.
#pragma once

#include <array>
#include <cstdint>

#include "query/traverse/interest.h"
#include "query/traverse/target.h"
#include "query/view/brick_view.h"

namespace isonest::detail {

struct CubeNodes {
    CubeValues value;                    ///< the data
    CubeValues distance;                 ///< of a plane, if one is marched
    const CubeValues* target = nullptr;  ///< what is marched: one of the two
    Int3 low;                            ///< in nodes of the brick's level
    unsigned mirror = 0;                 ///< axes along which the topology tables are mirrored
    Sides sides{~0U, ~0U};               ///< anything, until `sharp`
    bool sharp = false;
    std::uint32_t special = 0;   ///< bit p: its value is the isovalue or missing, if that was asked
    std::uint32_t asked = 0;     ///< bit p: it is known whether the node stops
    std::uint32_t stopping = 0;  ///< bit p: it does
    bool cut = false;            ///< reaches across the box

    CubeNodes() = default;
    CubeNodes(const CubeNodes&) = delete;
    CubeNodes& operator=(const CubeNodes&) = delete;

    /// The subcube at a corner (bits x, y, z) of the tables' cube.
    [[nodiscard]] Int3 subcube(unsigned corner) const {
        return low + corner_offset(corner ^ mirror);
    }
};

/// Cube `parent` of the level above that of `array`. `values`: the brick's, from node `base` on;
/// `stride`: of the brick's nodes in the finest lattice.
template <class T>
void load(CubeNodes& nodes, const Int3& parent, ChunkGroup& values, const ArrayInfo& array,
          const Int3& base, const Target& target, std::int64_t stride) {
    nodes.low = parent * 2;
    nodes.mirror = mirror_of(parent);
    const Int3 last = array.nodes - Int3{1, 1, 1} - base;
    const Int3 low = nodes.low - base;
    const T* const near = values.template within_first<T>(low, 2);
    const bool inside =
        near != nullptr && low.x + 2 <= last.x && low.y + 2 <= last.y && low.z + 2 <= last.z;
    for (int position = 0; position < 27; ++position) {
        const Int3 offset = node_offset(position, nodes.mirror);
        double& value = nodes.value[static_cast<std::size_t>(position)];
        if (inside) {
            value = static_cast<double>(near[array.chunk.linear(offset)]);
            continue;
        }
        // Beyond the lattice of this level (only there for a parent that reaches outside the
        // volume) the nearest node's value holds.
        value = static_cast<double>(values.template at<T>(min(low + offset, last)));
    }
    nodes.target = &nodes.value;
    if (target.is_plane()) {
        nodes.distance = target.distances(nodes.low, nodes.mirror, stride);
        nodes.target = &nodes.distance;
    }
}

/// Bits of the nodes of a cube's tetrahedra in `mask`.
inline std::uint32_t nodes_of(const std::array<TopologyTetrahedron, 6>& tetrahedra,
                              std::uint8_t mask) {
    std::uint32_t nodes = 0;
    for (unsigned order = 0; order < 6; ++order) {
        nodes |= (mask >> order & 1U) != 0 ? tetrahedra[order].nodes : 0;
    }
    return nodes;
}

}  // namespace isonest::detail
