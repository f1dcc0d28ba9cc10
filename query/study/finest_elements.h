// The elements of the finest level in a slab of the volume, one cell after another.
//
// Source: Maubach (1995), as in store/lattice/lattice.h: an element walks along the axes from the
// all-even corner of its cell to the all-odd one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <isonest/int3.h>

#include "query/traverse/element.h"

namespace isonest::detail {

/// The order in which an element of the finest level walks along the axes.
template <int D>
struct AxisWalk {
    std::array<std::size_t, D> axes{};
};

/// The D! walks of a lattice of dimension D.
template <int D>
std::vector<AxisWalk<D>> axis_walks(const Lattice& lattice) {
    std::vector<AxisWalk<D>> walks;
    for (const Element<D>& t : coarsest_elements<D>(lattice)) {
        AxisWalk<D> walk;
        for (std::size_t i = 0; i < D; ++i) {
            const Int3 step = t.v[i + 1] - t.v[i];
            walk.axes[i] = step.x != 0 ? 0 : step.y != 0 ? 1 : 2;
        }
        walks.push_back(walk);
    }
    return walks;
}

/// The nodes of the element of the cell whose low corner is `cell`.
template <int D>
std::array<Int3, D + 1> finest_element(const Int3& cell, const AxisWalk<D>& walk) {
    std::array<Int3, D + 1> v;
    v[0] = cell;
    for (std::size_t i = 0; i < D; ++i) {
        const int axis = static_cast<int>(walk.axes[i]);
        v[0][axis] += cell[axis] & 1;
    }
    for (std::size_t i = 0; i < D; ++i) {
        const int axis = static_cast<int>(walk.axes[i]);
        v[i + 1] = v[i];
        v[i + 1][axis] += (cell[axis] & 1) != 0 ? -1 : 1;
    }
    return v;
}

}  // namespace isonest::detail
