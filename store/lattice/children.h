// The children of a refinement node: the refinement nodes of the two halves of each of its
// elements.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5, where they saturate an indicator.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

#include <isonest/int3.h>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The nodes of a cube or square that have the node as their centre or face centre: its faces'
/// centres or its edges' midpoints, 2 along each odd axis. For an edge midpoint the centres of the
/// elements around it: 2 along each axis that is not flat.
struct ChildOffsets {
    std::array<Int3, 8> offsets{};
    std::size_t count = 0;
};

constexpr ChildOffsets make_child_offsets(unsigned odd, unsigned flat) {
    ChildOffsets children;
    if (std::popcount(odd) > 1) {
        for (int axis = 0; axis < 3; ++axis) {
            if ((odd >> static_cast<unsigned>(axis) & 1U) != 0) {
                children.offsets[children.count++][axis] = -1;
                children.offsets[children.count++][axis] = 1;
            }
        }
        return children;
    }
    children.count = 1;
    for (int axis = 0; axis < 3; ++axis) {
        if ((flat >> static_cast<unsigned>(axis) & 1U) == 0) {
            for (std::size_t i = 0; i < children.count; ++i) {
                children.offsets[i + children.count] = children.offsets[i];
                children.offsets[i][axis] = -1;
                children.offsets[i + children.count][axis] = 1;
            }
            children.count *= 2;
        }
    }
    return children;
}

inline constexpr auto kChildOffsets = [] {
    std::array<std::array<ChildOffsets, 8>, 8> table{};
    for (unsigned flat = 0; flat < 8; ++flat) {
        for (unsigned odd = 1; odd < 8; ++odd) {
            if ((odd & flat) == 0) {
                table[flat][odd] = make_child_offsets(odd, flat);
            }
        }
    }
    return table;
}();

/// From a refinement node to its children, in units of child_scale(). `odd`: its odd axes after
/// division by its scale (bits x, y, z); `flat`: Lattice::flat_axes(). An edge midpoint lacks those
/// children whose cubes the lattice does not have. REQUIRES: odd is not 0 and has no flat axis.
constexpr std::span<const Int3> child_offsets(unsigned odd, unsigned flat) {
    const ChildOffsets& children = kChildOffsets[flat][odd];
    return {children.offsets.data(), children.count};
}

/// The scale of the children of a node of this scale; 0 if it has none.
constexpr std::int64_t child_scale(unsigned odd, std::int64_t scale) {
    return std::popcount(odd) > 1 ? scale : scale / 2;
}

/// Calls f(child) for each child of refinement node p.
template <class F>
void for_children(const Lattice& lattice, const Int3& p, const NodeInfo& node, const F& f) {
    const unsigned odd =
        (node.odd[0] ? 1U : 0U) | (node.odd[1] ? 2U : 0U) | (node.odd[2] ? 4U : 0U);
    const std::int64_t step = child_scale(odd, node.scale);
    if (step == 0) {
        return;
    }
    // Only the children of edge midpoints can be missing.
    const Int3 end = node.kind == NodeKind::edge ? lattice.cells_at(node.level() - 1) * node.scale
                                                 : lattice.cells_at(node.level()) * 2 * node.scale;
    for (const Int3& offset : child_offsets(odd, lattice.flat_axes())) {
        const Int3 child = p + offset * step;
        if (min(child, {0, 0, 0}) == Int3{0, 0, 0} && max(child, end) == end) {
            f(child);
        }
    }
}

}  // namespace isonest::detail
