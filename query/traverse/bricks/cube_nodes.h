// What a brick knows of one cube of the level above while it refines the cube's tetrahedra.
#pragma once

#include <array>
#include <cstdint>

#include <isonest/value_type.h>

#include "query/traverse/interest.h"
#include "query/view/brick_view.h"

namespace isonest::detail {

struct CubeNodes {
    CubeValues value;       ///< the data
    CubeValues distance;    ///< from the plane, if one is marched
    Int3 low;               ///< in nodes of the brick's level
    unsigned mirror = 0;    ///< axes along which the topology tables are mirrored
    Sides sides{~0U, ~0U};  ///< anything, until `sharp`
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

/// Loads the values of cubes of the level above a brick's. Not thread-safe.
class CubeLoader {
  public:
    /// `base`: the brick's first node, in nodes of its level.
    CubeLoader(ChunkCache& cache, int level, const Int3& base)
        : array_(cache.source().layout().array(level, Field::values)),
          type_(cache.source().layout().header().type),
          base_(base),
          values_(cache, array_, base) {}

    /// Cube `parent` of the level above, as the topology tables are mirrored there.
    void load(CubeNodes& nodes, const Int3& parent) const {
        load(nodes, parent, mirror_of(parent));
    }
    /// The same, mirrored along the axes set in `mirror`.
    void load(CubeNodes& nodes, const Int3& parent, unsigned mirror) const {
        nodes.low = parent * 2;
        nodes.mirror = mirror;
        dispatch(type_, [&](auto tag) { load_as<typename decltype(tag)::type>(nodes); });
    }

  private:
    template <class T>
    void load_as(CubeNodes& nodes) const {
        const Int3 last = array_.nodes - Int3{1, 1, 1} - base_;
        const Int3 low = nodes.low - base_;
        const T* const near = values_.within_first<T>(low, 2);
        const bool inside =
            near != nullptr && low.x + 2 <= last.x && low.y + 2 <= last.y && low.z + 2 <= last.z;
        for (int position = 0; position < 27; ++position) {
            const Int3 offset = node_offset(position, nodes.mirror);
            double& value = nodes.value[static_cast<std::size_t>(position)];
            if (inside) {
                value = static_cast<double>(near[array_.chunk.linear(offset)]);
                continue;
            }
            // Beyond the lattice of this level (only there for a parent that reaches outside the
            // volume) the nearest node's value holds.
            value = static_cast<double>(values_.at<T>(min(low + offset, last)));
        }
    }

    const ArrayInfo& array_;
    ValueType type_;
    Int3 base_;
    ChunkGroup values_;
};

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
