// The refined nodes of a lattice: those whose indicator is not below a threshold, and all others
// needed for a grid without hanging nodes that ends where the volume ends.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 4, 5 and 7. A node is active if bar(x) =
// max(eta(x), max bar(c)) >= threshold, where c are the child nodes; so one bit per node is
// sufficient. If the volume does not end at a cube of a level, the elements that extend beyond it
// are also refined: elements outside are omitted, all others are in the volume.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include <isonest/field.h>
#include <isonest/implicit_grid.h>
#include <isonest/int3.h>
#include <isonest/progress.h>

#include "store/container/chunk_cache.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// The refinement nodes of one slot and level of a lattice, row by row along x.

/// Multiples of `scale` that are odd along some axes and even along the others, within the volume.
struct SlotRows {
    std::int64_t scale;
    Int3 odd;    ///< 0 or 1 per axis
    Int3 count;  ///< per axis

    SlotRows(const Lattice& lattice, int level, int slot)
        : scale(std::int64_t{1} << (level - 1)), odd(slot_offset(slot)) {
        for (int axis = 0; axis < 3; ++axis) {
            const std::int64_t last = lattice.nodes()[axis] - 1 - odd[axis] * scale;
            count[axis] = last < 0 ? 0 : last / (2 * scale) + 1;
        }
    }
    [[nodiscard]] std::int64_t rows() const { return count.y * count.z; }
    [[nodiscard]] Int3 first_of(std::int64_t row) const { return node(0, row); }
    [[nodiscard]] Int3 node(std::int64_t i, std::int64_t row) const {
        return (Int3{i, row % count.y, row / count.y} * 2 + odd) * scale;
    }
    /// If p is the i-th node of a row, the ends of its refinement edge are p - half and p + half.
    [[nodiscard]] Int3 half_edge(std::int64_t i, const Int3& p) const {
        const auto along = [&](int axis, std::int64_t q) {
            return odd[axis] == 0 ? 0 : (q & 1) != 0 ? -scale : scale;
        };
        return {along(0, i), along(1, p.y / scale / 2), along(2, p.z / scale / 2)};
    }
};

/// eta_{1,infinity} of the hat function at a node: |grad| = factor * |U_delta|. `odd_axes`: bits of
/// the axes along which the node's refinement edge runs. REQUIRES: level > 0, at least one odd
/// axis, and no flat one among them.
double hat_gradient(const Lattice& lattice, const Double3& spacing, int level, unsigned odd_axes);

/// The refined nodes and the corners of the coarsest elements. `wanted`: whether the indicator,
/// saturated or not, is large enough at a refinement node of a level; called from many threads.
/// `threads`: 0 = all. Throws what `wanted` throws and Error{cancelled}.
NodeSet active_nodes(const Lattice& lattice,
                     const std::function<bool(const Int3& p, int level)>& wanted, int threads,
                     Progress& progress);

/// By eta_{1,infinity} (Field::grad_linf_bar) of the values of all nodes in memory, x fastest. A
/// threshold of 0 makes all nodes active. REQUIRES: they are finite; threshold >= 0.
template <class Real>
NodeSet active_nodes(const Lattice& lattice, const Double3& spacing, std::span<const Real> values,
                     double threshold, int threads, Progress& progress);

/// Active nodes by a field of a store.
NodeSet active_nodes(ChunkCache& cache, Field field, double threshold, int threads,
                     Progress& progress);

}  // namespace isonest::detail
