#include "query/traverse/hexahedra/hex_projection.h"

#include <algorithm>

#include "query/march/march_hexahedron.h"

namespace isonest::detail {

bool HexProjection::is_refined(int level, const Int3& cell) {
    const Int3 cells = lattice_.elements_at(level);
    return min(cell, {0, 0, 0}) == Int3{0, 0, 0} && max(cell + Int3{1, 1, 1}, cells) == cells &&
           !stops(number(level, cell));
}

double HexProjection::projected(const Int3& node) {
    const NodeInfo info = describe_node(node, lattice_.top());
    if (info.scale == 0) {
        return value(node, lattice_.top());
    }
    const auto below = [this](int level, const Int3& cell) {
        const double of_cell = number(level, cell);
        largest_number_ = stops(of_cell) ? std::max(largest_number_, of_cell) : largest_number_;
        return stops(of_cell);
    };
    return hangs(lattice_, node, info, below)
               ? mean_of_corners(node, info, [this](const Int3& end) { return projected(end); })
               : value(node, info.level() - 1);
}

std::uint32_t HexProjection::nodes_of(int level, const Int3& cell) {
    std::uint32_t nodes = kHexCorners;
    if (level == 0) {
        return nodes;
    }
    constexpr Int3 kNeighbours{3, 3, 3};
    for (std::int64_t i = 0; i < 27; ++i) {
        const Int3 d = kNeighbours.unlinear(i) - Int3{1, 1, 1};
        const std::int64_t axes = d.x * d.x + d.y * d.y + d.z * d.z;
        if (axes == 0 || axes == 3 || !is_refined(level, cell + d)) {
            continue;
        }
        // Beside a face: its centre and the midpoints of its edges. Beside an edge: its midpoint.
        for (std::int64_t p = 0; p < 27; ++p) {
            const Int3 o = kNeighbours.unlinear(p) - Int3{1, 1, 1};
            const std::int64_t off = o.x * o.x + o.y * o.y + o.z * o.z;
            const bool there =
                (d.x == 0 || o.x == d.x) && (d.y == 0 || o.y == d.y) && (d.z == 0 || o.z == d.z);
            nodes |= (there && off >= 1 && off <= 2 ? 1U : 0U) << static_cast<unsigned>(p);
        }
    }
    return nodes;
}

}  // namespace isonest::detail
