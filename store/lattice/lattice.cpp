#include "store/lattice/lattice.h"

#include <bit>
#include <cassert>

namespace isonest::detail {

Lattice::Lattice(const Int3& nodes) : nodes_(nodes) {
    assert(min(nodes, {1, 1, 1}) == (Int3{1, 1, 1}));
    while (true) {
        const Int3 cells = cells_at(top_);
        if (std::max({cells.x, cells.y, cells.z}) <= 1) {
            break;
        }
        ++top_;
    }
}

Int3 Lattice::cells_at(int level) const {
    const std::int64_t stride = std::int64_t{1} << level;
    return ceil_div(nodes_ - Int3{1, 1, 1}, {stride, stride, stride});
}

Int3 Lattice::nodes_at(int level) const {
    return cells_at(level) + Int3{1, 1, 1};
}

unsigned Lattice::flat_axes() const {
    return (nodes_.x == 1 ? 1U : 0U) + (nodes_.y == 1 ? 2U : 0U) + (nodes_.z == 1 ? 4U : 0U);
}

int Lattice::dimension() const {
    return 3 - std::popcount(flat_axes());
}

Int3 Lattice::elements_at(int level) const {
    return max(cells_at(level), {1, 1, 1});
}

int Lattice::centre_slot() const {
    return static_cast<int>(7U & ~flat_axes()) - 1;
}

NodeInfo describe_node(const Int3& x, int top) {
    NodeInfo info;
    const auto all = static_cast<std::uint64_t>(x.x | x.y | x.z);
    if (all == 0 || std::countr_zero(all) >= top) {
        return info;
    }
    info.scale = std::int64_t{1} << std::countr_zero(all);
    info.end0 = x;
    info.end1 = x;
    int odd = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t q = x[axis] / info.scale;
        if ((q & 1) == 0) {
            continue;
        }
        ++odd;
        info.odd[static_cast<std::size_t>(axis)] = true;
        const std::int64_t sigma = (q & 3) == 1 ? info.scale : -info.scale;
        info.end0[axis] -= sigma;
        info.end1[axis] += sigma;
    }
    info.kind = static_cast<NodeKind>(odd);
    return info;
}

}  // namespace isonest::detail
