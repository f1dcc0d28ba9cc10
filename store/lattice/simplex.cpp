#include "store/lattice/simplex.h"

#include <bit>

namespace isonest::detail {

Tetrahedron kuhn_tetrahedron(const Int3& cube, std::int64_t edge, int order) {
    Int3 at;
    Int3 step;
    for (int axis = 0; axis < 3; ++axis) {
        const bool odd = (cube[axis] & 1) != 0;
        at[axis] = (cube[axis] + (odd ? 1 : 0)) * edge;
        step[axis] = odd ? -edge : edge;
    }
    Tetrahedron t;
    t.level = std::countr_zero(static_cast<std::uint64_t>(edge));
    t.v[0] = at;
    for (std::size_t i = 0; i < 3; ++i) {
        const int axis = kAxisOrders[static_cast<std::size_t>(order)][i];
        at[axis] += step[axis];
        t.v[i + 1] = at;
    }
    return t;
}

}  // namespace isonest::detail
