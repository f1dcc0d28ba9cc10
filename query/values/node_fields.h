// Indicators at the nodes of any level, and values between nodes.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "store/base/box.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Throws Error{invalid_argument} for values or a field of cells, and Error{not_found} for a field
/// that the store lacks.
void require_field_of_nodes(const StoreReader& store, Field field);

/// As fill_indicators(), for a box of nodes of a level: node p is node 2^level p of the finest
/// lattice.
void fill_indicators_at(ChunkCache& cache, Field field, int level, Box<double>& box);

/// The function that is linear on the tetrahedra (triangles, edges) of a lattice. `cell`: low
/// corner of a cell; `in_cell`: the place in it, from 0 to 1 along each axis, 0 along flat ones.
/// value(node) is called for the nodes that have a weight.
///
/// Source: Kuhn (1960), Maubach (1995), as in store/lattice/lattice.h: an element walks along the
/// axes from the all-even corner of its cube to the all-odd one; that of a place takes them in the
/// order of its coordinates relative to the even corner, largest first.
template <class Value>
double linear_value(const Int3& cell, const Double3& in_cell, const Value& value) {
    Int3 corner = cell;
    std::array<double, 3> along{};  // from the all-even corner
    std::array<int, 3> axes{0, 1, 2};
    for (std::size_t a = 0; a < 3; ++a) {
        const int axis = static_cast<int>(a);
        const bool is_odd = (cell[axis] & 1) != 0;
        along[a] = is_odd ? 1 - in_cell[a] : in_cell[a];
        corner[axis] += is_odd ? 1 : 0;
    }
    std::stable_sort(axes.begin(), axes.end(), [&](int a, int b) {
        return along[static_cast<std::size_t>(a)] > along[static_cast<std::size_t>(b)];
    });
    double sum = 0;
    double before = 1;
    for (std::size_t i = 0; i <= axes.size(); ++i) {
        const double next = i < axes.size() ? along[static_cast<std::size_t>(axes[i])] : 0;
        if (before > next) {
            sum += (before - next) * value(corner);
        }
        if (i < axes.size()) {
            corner[axes[i]] += (cell[axes[i]] & 1) != 0 ? -1 : 1;
        }
        before = next;
    }
    return sum;
}

}  // namespace isonest::detail
