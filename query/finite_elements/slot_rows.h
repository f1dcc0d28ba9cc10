// The refinement nodes of one slot and level of a lattice, row by row along x.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Multiples of `scale` that are odd along some axes and even along the others; those in the
/// volume.
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
    /// From the i-th node p of a row, the ends of its refinement edge are p - half and p + half.
    [[nodiscard]] Int3 half_edge(std::int64_t i, const Int3& p) const {
        const auto along = [&](int axis, std::int64_t q) {
            return odd[axis] == 0 ? 0 : (q & 1) != 0 ? -scale : scale;
        };
        return {along(0, i), along(1, p.y / scale / 2), along(2, p.z / scale / 2)};
    }
};

}  // namespace isonest::detail
