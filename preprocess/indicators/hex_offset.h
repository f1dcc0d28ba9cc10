// The indicators of hexahedral (quadrilateral) cells: one number per cube of a level.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 1 and Fig. 4. The offset indicator of section 4
// is transferred to cells that are refined into eight: the largest difference from the function
// that is d-linear in the cell, over the nodes of the cell's children that are not nodes of the
// cell.
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

/// A node in the middle between two others, `step` positions before and after it.
struct MiddleNode {
    std::uint8_t position;
    std::uint8_t step;
};
/// The 19 nodes of a cell that are not corners, each after the two nodes around it.
constexpr std::array<MiddleNode, 19> make_middle_nodes() {
    constexpr std::array<unsigned, 3> kStep{1, 3, 9};
    std::array<MiddleNode, 19> nodes{};
    std::size_t count = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (unsigned p = 0; p < 27; ++p) {
            // Any position along the axes processed so far; corners along later ones.
            bool here = p / kStep[axis] % 3 == 1;
            for (std::size_t later = axis + 1; later < 3; ++later) {
                here = here && p / kStep[later] % 3 != 1;
            }
            if (here) {
                nodes[count++] = {static_cast<std::uint8_t>(p),
                                  static_cast<std::uint8_t>(kStep[axis])};
            }
        }
    }
    return nodes;
}
inline constexpr std::array<MiddleNode, 19> kMiddleNodes = make_middle_nodes();

/// The offset of one cell. `u`: values at node positions x + 3 y + 9 z (half edges), equal along
/// flat axes. Infinite if one is missing, or if sums of them exceed the range of doubles. The
/// result is at least the exact number; `rounded`: the values are doubles, whose means may be
/// rounded.
inline double hex_offset(const std::array<double, 27>& u, bool rounded) {
    std::array<double, 27> linear = u;
    double largest = 0;
    double all = 0;  // NaN if a value is missing
    for (const auto [p, step] : kMiddleNodes) {
        linear[p] = 0.5 * (linear[p - step] + linear[p + step]);
        const double d = std::fabs(u[p] - linear[p]);
        largest = std::max(largest, d);
        all += d;
    }
    for (const std::size_t corner : {0U, 2U, 6U, 8U, 18U, 20U, 24U, 26U}) {
        all += 0 * u[corner];
    }
    if (!std::isfinite(all)) {
        return std::numeric_limits<double>::infinity();
    }
    if (!rounded) {
        return largest;
    }
    double size = 0;
    for (const double value : u) {
        size = std::max(size, std::fabs(value));
    }
    return largest + 8 * std::numeric_limits<double>::epsilon() * size;
}

/// Stores the offsets of the cells of layer k in the slot of their centres. `values`: `step` nodes
/// per half edge of a cell.
template <class Values, class Real>
void hex_offsets(const LayerRange& range, std::int64_t k, unsigned flat, int step,
                 const Values& values, Layer<Real>& layer) {
    using T = std::decay_t<decltype(values.data[0])>;
    const int slot = cell_slot(flat);
    const Int3 o = slot_offset(slot);
    std::array<std::int64_t, 27> offset{};
    for (std::int64_t p = 0; p < 27; ++p) {
        const Int3 at = Int3{3, 3, 3}.unlinear(p);
        offset[static_cast<std::size_t>(p)] =
            values.size.linear(Int3{at.x * o.x, at.y * o.y, at.z * o.z} * step);
    }
    std::array<double, 27> u{};
    each_node(range, slot, slot, [&](int, std::int64_t i, std::int64_t j) {
        const T* const low = &values.at(Int3{range.lo.x + i, range.lo.y + j, k} * (2 * step));
        for (std::size_t p = 0; p < 27; ++p) {
            u[p] = static_cast<double>(low[offset[p]]);
        }
        layer.row(slot, j)[i] = static_cast<Real>(hex_offset(u, std::is_same_v<T, double>));
    });
}

/// Saturates the cells of layer k over all cells of the next finer level that share a node with
/// them. `centres`: as for saturate_even_plane().
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
