// Missing data: a node whose diamond touches a non-finite value is refined to the end.
#pragma once

#include <limits>

#include "preprocess/indicators/layer.h"

namespace isonest::detail {

/// Which nodes of a box are missing (1) or not (0).
using MissingBox = Box<std::uint8_t>;

/// Level 1: sets eta to +inf where the node itself or an end of its refinement edge is missing.
/// That is enough there: what is left of a diamond consists of cells of the finest level. `missing`
/// as below.
template <class Real>
void mark_missing_finest(const LayerRange& range, std::int64_t k, int first_slot, int last_slot,
                         const MissingBox& missing, Layer<Real>& eta) {
    each_node(range, first_slot, last_slot, [&](int slot, std::int64_t i, std::int64_t j) {
        const Int3 p = Int3{range.lo.x + i, range.lo.y + j, k} * 2 + slot_offset(slot);
        const NodeInfo node = describe_node(p, 1);
        if (missing.at(p) != 0 || missing.at(node.end0) != 0 || missing.at(node.end1) != 0) {
            eta.row(slot, j)[i] = std::numeric_limits<Real>::infinity();
        }
    });
}

/// Sets eta to +inf where a vertex of a tetrahedron that refines at the node, or the node itself,
/// is missing. `missing` covers the lattice of stride 2^(L-1) from 2 lo - 1 to 2 hi + 1.
template <class Real>
void mark_missing(const LayerRange& range, std::int64_t k, int first_slot, int last_slot,
                  const MissingBox& missing, Layer<Real>& eta) {
    const auto is_missing = [&](const Int3& p) {
        const Int3 last = missing.lo + missing.size - Int3{1, 1, 1};
        return missing.at(max(missing.lo, min(p, last))) != 0;
    };
    // The diamond's vertices: of a centre the corners of the cube, of a face its corners and the
    // two centres, of an edge its ends and the faces and centres around it.
    each_node(range, first_slot, last_slot, [&](int slot, std::int64_t i, std::int64_t j) {
        const Int3 o = slot_offset(slot);
        const std::int64_t odd = o.x + o.y + o.z;
        const Int3 p = Int3{range.lo.x + i, range.lo.y + j, k} * 2 + o;
        bool found = false;
        for (std::int64_t d = 0; d < 27 && !found; ++d) {
            const Int3 e = (Int3{3, 3, 3}).unlinear(d) - Int3{1, 1, 1};
            std::int64_t along = 0;
            std::int64_t across = 0;
            for (int axis = 0; axis < 3; ++axis) {
                (o[axis] != 0 ? along : across) += e[axis] != 0 ? 1 : 0;
            }
            const bool vertex = (along == odd && across == 0) || along == 0;
            found = vertex && is_missing(p + e);
        }
        if (found) {
            eta.row(slot, j)[i] = std::numeric_limits<Real>::infinity();
        }
    });
}

}  // namespace isonest::detail
