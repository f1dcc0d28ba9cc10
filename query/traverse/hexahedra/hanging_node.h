// Which nodes hang on an adaptive grid of cells, and what holds there.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 1: cells of different size meet in hanging
// nodes, where what interpolation on the larger one's face or edge gives holds.
#pragma once

#include <cstdint>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Whether a node is within or on a cell that is not refined, and no corner of it.
/// `stops(level, cell)`: whether a cell that exists is below the threshold; those in it are, too.
/// REQUIRES: node.scale > 0.
template <class Stops>
bool hangs(const Lattice& lattice, const Int3& p, const NodeInfo& node, const Stops& stops) {
    const int level = node.level();  // of the cells of which it is no corner
    const std::int64_t edge = node.scale * 2;
    const Int3 cells = lattice.elements_at(level);
    // NOLINTNEXTLINE(clang-analyzer-core.DivideZero): the scale is more than 0
    const Int3 high{p.x / edge, p.y / edge, p.z / edge};
    for (unsigned i = 0; i < 8; ++i) {
        Int3 cell = high;
        bool twice = false;
        for (int axis = 0; axis < 3; ++axis) {
            const bool lower = (i >> static_cast<unsigned>(axis) & 1U) != 0;
            twice = twice || (lower && node.odd[static_cast<std::size_t>(axis)]);
            cell[axis] -= lower ? 1 : 0;
        }
        const bool exists = !twice && min(cell, {0, 0, 0}) == Int3{0, 0, 0} &&
                            max(cell + Int3{1, 1, 1}, cells) == cells;
        if (exists && stops(level, cell)) {
            return true;
        }
    }
    return false;
}

/// The mean of `value` at the ends of the edge, or corners of the face or cell, whose centre the
/// node is. REQUIRES: node.scale > 0.
template <class Value>
double mean_of_corners(const Int3& p, const NodeInfo& node, const Value& value) {
    double sum = 0;
    double count = 0;
    for (unsigned i = 0; i < 8; ++i) {
        Int3 end = p;
        bool twice = false;
        for (int axis = 0; axis < 3; ++axis) {
            const bool upper = (i >> static_cast<unsigned>(axis) & 1U) != 0;
            const bool odd = node.odd[static_cast<std::size_t>(axis)];
            twice = twice || (upper && !odd);
            end[axis] += !odd ? 0 : upper ? node.scale : -node.scale;
        }
        if (!twice) {
            sum += value(end);
            ++count;
        }
    }
    return sum / count;
}

}  // namespace isonest::detail
