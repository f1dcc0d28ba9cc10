// The indicators of hexahedral (quadrilateral) cells: one number for each cube of a level.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 1 and Fig. 4, the offset indicator of section 4
// carried over to cells that are refined into eight: the largest difference, in the nodes that do
// not belong to the cell but to its children, from the function that is d-linear in the cell.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include <isonest/field.h>

#include "preprocess/indicators/layer.h"

namespace isonest::detail {

/// The slot of the centres of cells; `flat`: bits of the flat axes.
constexpr int cell_slot(unsigned flat) {
    return slot_of((flat & 1U) != 0 ? 0 : 1, (flat & 2U) != 0 ? 0 : 1, (flat & 4U) != 0 ? 0 : 1);
}

/// Of one cell: `u` are the values at node positions x + 3 y + 9 z (half edges), those on flat axes
/// alike. Infinite if one is missing. At least the exact number, but for values beyond the range
/// of doubles that are rounded; `rounded`: the values are doubles.
inline double hex_offset(const std::array<double, 27>& u, bool rounded) {
    std::array<double, 27> linear = u;
    double largest = 0;
    double size = 0;
    constexpr std::array<std::size_t, 3> kStep{1, 3, 9};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (std::size_t p = 0; p < 27; ++p) {
            // Axes done so far may be anywhere, later ones in corners.
            bool here = p / kStep[axis] % 3 == 1;
            for (std::size_t later = axis + 1; later < 3; ++later) {
                here = here && p / kStep[later] % 3 != 1;
            }
            if (here) {
                linear[p] = (linear[p - kStep[axis]] + linear[p + kStep[axis]]) / 2;
            }
        }
    }
    for (std::size_t p = 0; p < 27; ++p) {
        const double d = std::fabs(u[p] - linear[p]);
        if (!std::isfinite(d)) {
            return std::numeric_limits<double>::infinity();
        }
        largest = std::max(largest, d);
        size = std::max(size, std::fabs(u[p]));
    }
    return rounded ? largest + 8 * std::numeric_limits<double>::epsilon() * size : largest;
}

/// Puts the offsets of the cells of layer k into the slot of their centres. `values`: `step` nodes
/// per half edge of a cell.
template <class Values, class Real>
void hex_offsets(const LayerRange& range, std::int64_t k, unsigned flat, int step,
                 const Values& values, Layer<Real>& layer) {
    using T = std::decay_t<decltype(values.data[0])>;
    const int slot = cell_slot(flat);
    const Int3 o = slot_offset(slot);
    std::array<Int3, 27> offset;
    for (std::int64_t p = 0; p < 27; ++p) {
        const Int3 at = Int3{3, 3, 3}.unlinear(p);
        offset[static_cast<std::size_t>(p)] = Int3{at.x * o.x, at.y * o.y, at.z * o.z} * step;
    }
    std::array<double, 27> u{};
    each_node(range, slot, slot, [&](int, std::int64_t i, std::int64_t j) {
        const Int3 low = Int3{range.lo.x + i, range.lo.y + j, k} * (2 * step);
        for (std::size_t p = 0; p < 27; ++p) {
            u[p] = static_cast<double>(values.at(low + offset[p]));
        }
        layer.row(slot, j)[i] = static_cast<Real>(hex_offset(u, std::is_same_v<T, double>));
    });
}

/// Saturates the cells of layer k by all cells of the next finer level that share a node with them.
/// `centres`: as saturate_even_plane() takes it.
template <class Real>
void saturate_cells(const LayerRange& range, std::int64_t k, unsigned flat,
                    const Box<float>* centres, Saturation saturation, Layer<Real>& layer) {
    const int slot = cell_slot(flat);
    if (centres == nullptr || ((flat & 4U) == 0 && k - range.lo.z >= range.odd_count(2))) {
        return;
    }
    const Int3 o = slot_offset(slot);
    each_node(range, slot, slot, [&](int, std::int64_t i, std::int64_t j) {
        const Int3 owner{range.lo.x + i, range.lo.y + j, k};
        const Int3 low = owner * 2 - o;
        const Int3 high = owner * 2 + o * 2;
        float most = 0;
        for (std::int64_t z = low.z; z <= high.z; ++z) {
            for (std::int64_t y = low.y; y <= high.y; ++y) {
                const float* const row = centres->row(y, z) - centres->lo.x;
                for (std::int64_t x = low.x; x <= high.x; ++x) {
                    most = std::max(most, row[x]);
                }
            }
        }
        Real& own = layer.row(slot, j)[i];
        const auto children = static_cast<Real>(most);
        own = saturation == Saturation::bar ? std::max(own, children) : own + children;
    });
}

}  // namespace isonest::detail
