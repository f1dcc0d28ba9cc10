// The nodes of one block of an implicit grid as dense arrays that stay in the processor's caches.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/finite_elements/node_set.h"

namespace isonest::detail {

/// A block is a cube (square, edge) of the nested grid of this level, or of the coarsest one.
template <int D>
inline constexpr int kBlockLevel = D == 3   ? 4
                                   : D == 2 ? 6
                                            : 8;

/// A node of a block: its coordinates from the block's corner in 12, 10 and 10 bits, so that the
/// sum of two, halved, is their midpoint.
using LocalNode = std::uint32_t;
inline constexpr std::array<unsigned, 3> kCoordinateShift{0, 12, 22};
constexpr LocalNode local_node(const Int3& p) {
    return static_cast<LocalNode>(p.x) | static_cast<LocalNode>(p.y) << kCoordinateShift[1] |
           static_cast<LocalNode>(p.z) << kCoordinateShift[2];
}
constexpr std::uint32_t coordinate(LocalNode node, std::size_t axis) {
    constexpr std::array<std::uint32_t, 3> kMask{0xFFF, 0x3FF, 0x3FF};
    return node >> kCoordinateShift.at(axis) & kMask.at(axis);
}
constexpr LocalNode midpoint(LocalNode a, LocalNode b) {
    return (a + b) >> 1U;
}

/// Where a block's nodes lie in its arrays: in each row along x those with even coordinates first,
/// then the odd ones, so that equal nodes of neighbouring cells of one parity lie side by side.
template <int D>
struct BlockLayout {
    static constexpr std::uint32_t kCells = 1U << static_cast<unsigned>(kBlockLevel<D>);
    static constexpr std::uint32_t kEven = kCells / 2 + 1;
    static constexpr std::uint32_t kRow = kCells + 4;
    std::uint32_t rows = 1;    ///< nodes along y
    std::uint32_t planes = 1;  ///< along z

    /// `flat`: bits of the axes with a single node.
    explicit BlockLayout(unsigned flat)
        : rows((flat & 2U) != 0 ? 1 : kCells + 1), planes((flat & 4U) != 0 ? 1 : kCells + 1) {}
    [[nodiscard]] static std::uint32_t in_row(std::uint32_t x) {
        return (x >> 1U) + (x & 1U) * kEven;
    }
    [[nodiscard]] std::uint32_t row(std::uint32_t y, std::uint32_t z) const {
        return (z * rows + y) * kRow;
    }
    [[nodiscard]] std::uint32_t at(LocalNode node) const {
        return row(coordinate(node, 1), coordinate(node, 2)) + in_row(coordinate(node, 0));
    }
    [[nodiscard]] std::size_t size() const { return std::size_t{rows} * planes * kRow; }
};

/// The arrays of a thread. What is not an active node of the volume is 0.
template <class Real, int D>
struct LocalBlock {
    explicit LocalBlock(unsigned flat)
        : layout(flat), active(layout.size()), value(layout.size()), stopping(layout.size()) {}

    BlockLayout<D> layout;
    std::vector<Real> active;    ///< 1 or 0
    std::vector<Real> value;     ///< of the function that is multiplied
    std::vector<Real> stopping;  ///< of the function whose gradient gives the coefficients
    bool is_full = false;        ///< all its nodes in the volume are active
    Int3 corner{0, 0, 0};
    Int3 last{0, 0, 0};   ///< the volume's last node, from the corner
    bool is_cut = false;  ///< it reaches out of the volume
};

}  // namespace isonest::detail
