// The indicators of hexahedral and quadrilateral cells by loops over all nodes of each cell.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "store/lattice/lattice.h"
#include "tests/test_support.h"

namespace isonest::detail::test {

/// Per level from 1 on, the cells' numbers, x fastest.
struct CellNumbers {
    Int3 cells;
    std::vector<double> bar;
    std::vector<double> plus;
};

template <class T>
std::vector<CellNumbers> cell_numbers_by_loops(const FunctionVolume<T>& volume,
                                               const Lattice& lattice) {
    std::vector<CellNumbers> levels;
    for (int level = 1; level <= lattice.top(); ++level) {
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 n = volume.nodes();
        const Int3 flat{n.x == 1 ? 1 : 0, n.y == 1 ? 1 : 0, n.z == 1 ? 1 : 0};
        CellNumbers e;
        for (int axis = 0; axis < 3; ++axis) {
            e.cells[axis] = std::max<std::int64_t>((n[axis] - 2 + edge) / edge, 1);
        }
        for (std::int64_t i = 0; i < e.cells.product(); ++i) {
            const Int3 cell = e.cells.unlinear(i);
            double eta = 0;
            for (std::int64_t p = 0; p < 27; ++p) {
                const Int3 half = Int3{3, 3, 3}.unlinear(p);
                double linear = 0;
                for (std::int64_t c = 0; c < 8; ++c) {
                    double weight = 1;
                    Int3 corner;
                    for (int axis = 0; axis < 3; ++axis) {
                        const bool high = (c >> axis & 1) != 0;
                        const double t = static_cast<double>(half[axis]) / 2;
                        weight *= flat[axis] != 0 ? 0.5 : high ? t : 1 - t;
                        corner[axis] = flat[axis] != 0 ? 0 : (cell[axis] + (high ? 1 : 0)) * edge;
                    }
                    // A missing corner counts as well where its weight is 0.
                    linear += weight * volume.at(corner);
                }
                Int3 node;
                for (int axis = 0; axis < 3; ++axis) {
                    node[axis] = flat[axis] != 0 ? 0 : cell[axis] * edge + half[axis] * edge / 2;
                }
                const double d = std::fabs(volume.at(node) - linear);
                eta = std::isnan(d) ? std::numeric_limits<double>::infinity() : std::max(eta, d);
            }
            double bar = 0;
            double plus = 0;
            for (std::int64_t c = 0; c < 64 && level > 1; ++c) {
                const CellNumbers& finer = levels.back();
                Int3 at = cell * 2 + Int3{4, 4, 4}.unlinear(c) - Int3{1, 1, 1};
                for (int axis = 0; axis < 3; ++axis) {
                    at[axis] = flat[axis] != 0 ? 0 : at[axis];
                }
                if (min(at, {0, 0, 0}) == Int3{0, 0, 0} &&
                    max(at + Int3{1, 1, 1}, finer.cells) == finer.cells) {
                    const auto which = static_cast<std::size_t>(finer.cells.linear(at));
                    bar = std::max(bar, finer.bar[which]);
                    plus = std::max(plus, finer.plus[which]);
                }
            }
            e.bar.push_back(std::max(eta, bar));
            e.plus.push_back(eta + plus);
        }
        levels.push_back(e);
    }
    return levels;
}

}  // namespace isonest::detail::test
