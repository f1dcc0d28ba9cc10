#include "query/traverse/hex_projection.h"

#include "query/march/hex_cell.h"

namespace isonest::detail {

bool HexProjection::is_refined(int level, const Int3& cell) {
    const Int3 cells = lattice_.elements_at(level);
    return min(cell, {0, 0, 0}) == Int3{0, 0, 0} && max(cell + Int3{1, 1, 1}, cells) == cells &&
           !stops(number(level, cell));
}

double HexProjection::value(const Int3& node) {
    const NodeInfo info = describe_node(node, lattice_.top());
    if (info.scale == 0) {
        return exact(node, lattice_.top());
    }
    const int level = info.level();  // of the cells of which it is no corner
    const std::int64_t edge = info.scale * 2;
    const Int3 cells = lattice_.elements_at(level);
    bool hangs = false;
    const Int3 high{node.x / edge, node.y / edge, node.z / edge};
    for (unsigned i = 0; i < 8 && !hangs; ++i) {
        Int3 cell = high;
        bool twice = false;
        for (int axis = 0; axis < 3; ++axis) {
            const bool lower = (i >> static_cast<unsigned>(axis) & 1U) != 0;
            twice = twice || (lower && info.odd[static_cast<std::size_t>(axis)]);
            cell[axis] -= lower ? 1 : 0;
        }
        const bool exists = !twice && min(cell, {0, 0, 0}) == Int3{0, 0, 0} &&
                            max(cell + Int3{1, 1, 1}, cells) == cells;
        hangs = exists && stops(number(level, cell));
    }
    if (!hangs) {
        return exact(node, level - 1);
    }
    double sum = 0;
    double count = 0;
    for (unsigned i = 0; i < 8; ++i) {
        Int3 end = node;
        bool twice = false;
        for (int axis = 0; axis < 3; ++axis) {
            const bool upper = (i >> static_cast<unsigned>(axis) & 1U) != 0;
            const bool odd = info.odd[static_cast<std::size_t>(axis)];
            twice = twice || (upper && !odd);
            end[axis] += !odd ? 0 : upper ? info.scale : -info.scale;
        }
        if (!twice) {
            sum += value(end);
            ++count;
        }
    }
    return sum / count;
}

std::uint32_t HexProjection::nodes_of(int level, const Int3& cell) {
    std::uint32_t nodes = kHexCorners;
    if (level == 0) {
        return nodes;
    }
    constexpr Int3 kAround{3, 3, 3};
    for (std::int64_t i = 0; i < 27; ++i) {
        const Int3 d = kAround.unlinear(i) - Int3{1, 1, 1};
        const std::int64_t axes = d.x * d.x + d.y * d.y + d.z * d.z;
        if (axes == 0 || axes == 3 || !is_refined(level, cell + d)) {
            continue;
        }
        // Beside a face its centre and the midpoints of its edges, beside an edge its midpoint.
        for (std::int64_t p = 0; p < 27; ++p) {
            const Int3 o = kAround.unlinear(p) - Int3{1, 1, 1};
            const std::int64_t off = o.x * o.x + o.y * o.y + o.z * o.z;
            const bool there =
                (d.x == 0 || o.x == d.x) && (d.y == 0 || o.y == d.y) && (d.z == 0 || o.z == d.z);
            nodes |= (there && off >= 1 && off <= 2 ? 1U : 0U) << static_cast<unsigned>(p);
        }
    }
    return nodes;
}

}  // namespace isonest::detail
