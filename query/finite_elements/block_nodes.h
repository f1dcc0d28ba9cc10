// One block of an implicit grid at work: its nodes are gathered, its leaves found.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/finite_elements/block_elements.h"

namespace isonest::detail {

/// What all blocks of a pass over the grid have in common.
template <class Real, int D>
struct BlockCommon {
    const NodeSet* nodes = nullptr;
    std::span<const Real> value;     ///< at the active nodes, of the function that is multiplied
    std::span<const Real> stopping;  ///< of the one whose gradient gives the coefficients
    TermsTable<Real, D> terms{};
    std::int64_t cells = 1;  ///< of a block, along an axis
    int level = 0;           ///< of a block
    unsigned flat = 0;
    std::vector<ElementAxes<D>> walks;
};

/// The rows of nodes in an array of the block at which a row of finest cells of one parity lies, as
/// BlockNodes::for_finest_cells says. Row: NodeRow or SumRow.
template <class Row, int D, class Real>
std::array<Row, 4> corner_rows(Real* array, const std::array<std::uint32_t, 4>& first,
                               std::uint32_t parity) {
    std::array<Row, 4> rows;
    for (std::size_t r = 0; r < 4; ++r) {
        rows[r] = {array + first[r] + parity, array + first[r] + BlockLayout<D>::kEven};
    }
    return rows;
}

/// A thread's arrays of one block after the other.
template <bool HasValue, bool HasStopping, class Real, int D>
class BlockNodes {
  public:
    explicit BlockNodes(const BlockCommon<Real, D>& common) : common_(common), block(common.flat) {}

    /// Calls f(first, p, count) for each row along x: its place in the arrays, its first node.
    template <class F>
    void for_rows(const F& f) {
        const std::int64_t count = block.last.x + 1;
        for (std::int64_t z = 0; z <= block.last.z; ++z) {
            for (std::int64_t y = 0; y <= block.last.y; ++y) {
                f(block.layout.row(static_cast<std::uint32_t>(y), static_cast<std::uint32_t>(z)),
                  block.corner + Int3{0, y, z}, count);
            }
        }
    }

    void gather(const Int3& corner) {
        const Int3 last = common_.nodes->nodes() - Int3{1, 1, 1} - corner;
        const Int3 whole = Int3{1, 1, 1} * common_.cells;
        block.corner = corner;
        block.last = min(last, whole);
        for (int axis = 0; axis < 3; ++axis) {
            if ((common_.flat >> static_cast<unsigned>(axis) & 1U) != 0) {
                block.last[axis] = 0;
            }
        }
        const Int3 reached = max(block.last, Int3{(common_.flat & 1U) != 0 ? whole.x : 0,
                                                  (common_.flat & 2U) != 0 ? whole.y : 0,
                                                  (common_.flat & 4U) != 0 ? whole.z : 0});
        block.is_cut = reached != whole;
        std::fill(block.active.begin(), block.active.end(), Real{0});
        if constexpr (HasValue) {
            std::fill(block.value.begin(), block.value.end(), Real{0});
        }
        if constexpr (HasStopping) {
            std::fill(block.stopping.begin(), block.stopping.end(), Real{0});
        }
        row_has_.clear();
        block.is_full = true;
        for_rows([&](std::uint32_t first, const Int3& p, std::int64_t count) {
            if (count <= 64 && common_.nodes->contains_row(p, count)) {
                gather_row(first, common_.nodes->number_from(p), static_cast<std::uint32_t>(count));
                row_has_.push_back(1);
                return;
            }
            std::uint8_t has = 0;
            bool all = true;
            std::int64_t next = p.x;
            common_.nodes->for_row(p, count, [&](std::int64_t x, std::uint64_t n) {
                const std::uint32_t at =
                    first + block.layout.in_row(static_cast<std::uint32_t>(x - p.x));
                block.active[at] = 1;
                if constexpr (HasValue) {
                    block.value[at] = common_.value[n];
                }
                if constexpr (HasStopping) {
                    block.stopping[at] = common_.stopping[n];
                }
                has = 1;
                all = all && x == next;
                ++next;
            });
            row_has_.push_back(has);
            block.is_full = block.is_full && all && next == p.x + count;
        });
    }

    /// Calls f(y, z, first, parity, there) for each row of the finest cells that an active node
    /// touches, cells of one parity along x at a time: their place, the rows of nodes at them (by
    /// the parities of y (1) and z (2)) in the arrays, and 1 where a cell lies in the volume.
    /// In space.
    template <class F>
    void for_finest_cells(const F& f) const {
        std::array<std::array<Real, kCellsPerCall>, 2> there{};
        for (std::size_t parity = 0; parity < 2; ++parity) {
            for (std::size_t i = 0; i < kCellsPerCall; ++i) {
                there.at(parity).at(i) =
                    static_cast<std::int64_t>(2 * i + parity) < block.last.x ? 1 : 0;
            }
        }
        const auto rows = static_cast<std::size_t>(block.last.y + 1);
        for (std::int64_t z = 0; z < block.last.z; ++z) {
            for (std::int64_t y = 0; y < block.last.y; ++y) {
                std::array<std::uint32_t, 4> first{};
                std::array<bool, 4> has{};
                for (unsigned r = 0; r < 4; ++r) {
                    // The node with this parity of the two.
                    const std::int64_t at_y = y + ((y & 1) != static_cast<std::int64_t>(r & 1U));
                    const std::int64_t at_z = z + ((z & 1) != static_cast<std::int64_t>(r >> 1U));
                    first.at(r) = block.layout.row(static_cast<std::uint32_t>(at_y),
                                                   static_cast<std::uint32_t>(at_z));
                    has.at(r) = row_has_[static_cast<std::size_t>(at_z) * rows +
                                         static_cast<std::size_t>(at_y)] != 0;
                }
                if (!has[0] && !has[1] && !has[2]) {
                    continue;
                }
                for (std::uint32_t parity = 0; parity < 2; ++parity) {
                    f(y, z, first, parity, there.at(parity).data());
                }
            }
        }
    }

    /// Calls on_leaf for the leaves that for_finest_cells does not do. `elements`: bits of the
    /// walks that are this block's.
    template <class OnLeaf>
    void visit(std::uint32_t elements, OnLeaf& on_leaf) const {
        if (D == 3 && (block.is_full || common_.level == 0)) {
            return;
        }
        BlockElements<Real, D, OnLeaf> leaves(block, on_leaf);
        Int3 even{0, 0, 0};
        for (int axis = 0; axis < 3; ++axis) {
            even[axis] = (block.corner[axis] / common_.cells & 1) != 0 ? common_.cells : 0;
        }
        for (std::size_t walk = 0; walk < common_.walks.size(); ++walk) {
            if ((elements >> walk & 1U) != 0) {
                leaves.walk(even, common_.walks[walk], common_.cells, common_.level);
            }
        }
    }

  private:
    /// A row of which all nodes are active.
    void gather_row(std::uint32_t first, std::uint64_t number, std::uint32_t count) {
        const auto split = [&](const Real* from, Real* to) {
            Real* const odd = to + BlockLayout<D>::kEven;
            for (std::uint32_t i = 0; i < count / 2; ++i) {
                to[i] = from[2 * i];
                odd[i] = from[2 * i + 1];
            }
            if (count % 2 != 0) {
                to[count / 2] = from[count - 1];
            }
        };
        Real* const active = block.active.data() + first;
        std::fill(active, active + (count + 1) / 2, Real{1});
        std::fill(active + BlockLayout<D>::kEven, active + BlockLayout<D>::kEven + count / 2,
                  Real{1});
        if constexpr (HasValue) {
            split(common_.value.data() + number, block.value.data() + first);
        }
        if constexpr (HasStopping) {
            split(common_.stopping.data() + number, block.stopping.data() + first);
        }
    }

    const BlockCommon<Real, D>& common_;
    std::vector<std::uint8_t> row_has_;  ///< whether a row has an active node

  public:
    LocalBlock<Real, D> block;
};

}  // namespace isonest::detail
