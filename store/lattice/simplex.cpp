#include "store/lattice/simplex.h"

namespace isonest::detail {

std::array<Tetrahedron, 2> Tetrahedron::bisect() const {
    const Int3 z = ref_node();
    switch (kind) {
        case 0:
            return {{{{v[0], v[1], v[2], z}, 1}, {{v[1], v[2], v[3], z}, 1}}};
        case 1:
            return {{{{v[0], v[1], z, v[3]}, 2}, {{v[1], v[2], z, v[3]}, 2}}};
        default:
            return {{{{v[0], z, v[2], v[3]}, 0}, {{v[1], z, v[2], v[3]}, 0}}};
    }
}

Tetrahedron kuhn_tetrahedron(const Int3& cube, std::int64_t edge, int order) {
    Int3 at;
    Int3 step;
    for (int axis = 0; axis < 3; ++axis) {
        const bool odd = (cube[axis] & 1) != 0;
        at[axis] = (cube[axis] + (odd ? 1 : 0)) * edge;
        step[axis] = odd ? -edge : edge;
    }
    Tetrahedron t;
    t.v[0] = at;
    for (std::size_t i = 0; i < 3; ++i) {
        const int axis = kAxisOrders[static_cast<std::size_t>(order)][i];
        at[axis] += step[axis];
        t.v[i + 1] = at;
    }
    return t;
}

}  // namespace isonest::detail
