// AdaptTraverse within one block: the leaves of an implicit grid.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 7. The refinement node of an element is
// the midpoint of two vertices, so only their positions are passed down; the stop test uses one
// number of the block's array. In three dimensions the finest elements are processed by
// finest_cells.h.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/finest_cells.h"
#include "query/finite_elements/linear_element.h"

namespace isonest::detail {

// The nodes of one block of an implicit grid as dense arrays that fit into the processor's caches.

/// A block is a cube (square, edge) of the nested grid of this level, or of the coarsest one.
template <int D>
inline constexpr int kBlockLevel = D == 3   ? 4
                                   : D == 2 ? 6
                                            : 8;

/// A node of a block: its coordinates relative to the block's corner in 12, 10 and 10 bits, so that
/// half the sum of two nodes is their midpoint.
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

/// The positions of a block's nodes in its arrays: in each row along x, first the nodes with even
/// coordinates, then the odd ones, so that corresponding nodes of neighbouring cells of the same
/// parity are adjacent.
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

/// The arrays of a thread. Entries that are not active nodes of the volume are 0.
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
    Int3 last{0, 0, 0};   ///< the volume's last node, relative to the corner
    bool is_cut = false;  ///< it extends beyond the volume
};

/// Constants of the elements of one kind and level.
template <class Real>
struct ElementTerms {
    Real volume = 0;
    Real stiffness = 0;             ///< factor times volume
    std::array<Real, 3> inverse{};  ///< 1 / (edge length)^2 by axis
    Real inverse_lambda = 0;        ///< 1 / lambda^2
};

/// Adds one leaf's part. `inverse`: along the leaf's own axes.
template <ElementWork Work, bool Coefficient, int D, int Kind, class Real>
[[gnu::always_inline]] inline void add_element(
    const ElementTerms<Real>& terms, const std::array<int, static_cast<std::size_t>(D)>& axes,
    const std::array<Real, static_cast<std::size_t>(D) + 1>& value,
    const std::array<Real, static_cast<std::size_t>(D) + 1>& stopping,
    std::array<Real, static_cast<std::size_t>(D) + 1>& out) {
    std::array<Real, static_cast<std::size_t>(D)> inverse;
    for (std::size_t j = 0; j < D; ++j) {
        inverse[j] = terms.inverse[static_cast<std::size_t>(axes[j])];
    }
    if constexpr (Work == ElementWork::lumped_mass) {
        for (Real& o : out) {
            o += terms.volume / (D + 1);
        }
    } else if constexpr (Work == ElementWork::consistent_mass) {
        add_mass<D>(terms.volume, value, out);
    } else {
        Real scale = terms.stiffness;
        if constexpr (Coefficient) {
            scale /= 1 + gradient_squared<D, Kind>(stopping, inverse) * terms.inverse_lambda;
        }
        if constexpr (Work == ElementWork::stiffness) {
            add_stiffness<D, Kind>(scale, inverse, value, out);
        } else {
            add_stiffness_diagonal<D, Kind>(scale, inverse, out);
        }
    }
}

/// Indexed by kind and level.
template <class Real, int D>
using TermsTable = std::array<std::array<ElementTerms<Real>, static_cast<std::size_t>(D)>, 32>;

template <int D>
using ElementAxes = std::array<int, static_cast<std::size_t>(D)>;

/// A vertex of an element in a block: the node, and its position in the block's arrays.
struct BlockVertex {
    LocalNode node;
    std::uint32_t at;
};
template <int D>
using BlockVertices = std::array<BlockVertex, static_cast<std::size_t>(D) + 1>;

/// Finds leaves and calls on_leaf.template operator()<Kind>(vertices, axes, level) for each.
template <class Real, int D, class OnLeaf>
class BlockElements {
    using Axes = ElementAxes<D>;
    using Vertex = BlockVertex;
    using Vertices = BlockVertices<D>;

  public:
    BlockElements(const LocalBlock<Real, D>& block, OnLeaf& on_leaf)
        : block_(block), on_leaf_(on_leaf) {}

    /// Visits all leaves of an element of kind 0 of the block: the walk along `axes` from the
    /// corner `even`, which is 0 or `cells` along each axis.
    void walk(const Int3& even, const Axes& axes, std::int64_t cells, int level) {
        Vertices v;
        Int3 p = even;
        v[0] = vertex(local_node(p));
        for (std::size_t i = 0; i < D; ++i) {
            p[axes[i]] = cells - p[axes[i]];
            v[i + 1] = vertex(local_node(p));
        }
        visit<0>(v, axes, level);
    }

  private:
    [[nodiscard]] Vertex vertex(LocalNode node) const { return {node, block_.layout.at(node)}; }
    /// Position of an element relative to the volume.
    enum class Reach { within, across, outside };
    [[nodiscard]] Reach reach(const Vertices& v) const {
        Reach found = Reach::within;
        for (int axis = 0; axis < 3; ++axis) {
            const auto last = block_.last[axis];
            std::int64_t low = last;
            std::int64_t high = last;
            for (const Vertex& x : v) {
                const std::int64_t at = coordinate(x.node, static_cast<std::size_t>(axis));
                low = std::min(low, at);
                high = std::max(high, at);
            }
            if (high > last) {
                if (low == last) {
                    return Reach::outside;
                }
                found = Reach::across;
            }
        }
        return found;
    }

    template <int Kind>
    void visit(const Vertices& v, const Axes& axes, int level) {
        constexpr std::size_t kEnd = D - Kind;
        constexpr int kNext = (Kind + 1) % D;
        const Reach where = block_.is_cut ? reach(v) : Reach::within;
        if (where == Reach::outside) {
            return;
        }
        if constexpr (D == 3 && Kind == 0) {
            if (level == 1 && where == Reach::within) {
                return walk_of_level_1(v, axes);
            }
        }
        if (level > 0) {
            const Vertex middle = vertex(midpoint(v[0].node, v[kEnd].node));
            if (where == Reach::across || block_.active[middle.at] != 0) {
                if constexpr (D == 3 && kNext == 0) {
                    if (level == 1) {
                        return;
                    }
                }
                const int below = kNext == 0 ? level - 1 : level;
                Vertices half = v;
                half[kEnd] = middle;
                visit<kNext>(half, axes, below);
                std::copy(v.begin() + 1, v.begin() + kEnd + 1, half.begin());
                half[kEnd] = middle;
                visit<kNext>(half, axes_of_second_half<D, Kind>(axes), below);
                return;
            }
        }
        leaf<Kind>(v, axes, level);
    }

    /// The same for an element of level 1 and kind 0, step by step: its two halves end at the nodes
    /// at the middle of two faces, their halves at the nodes at the middle of the walk's three
    /// steps.
    void walk_of_level_1(const Vertices& v, const Axes& axes) {
        const auto middle = [&](std::size_t i, std::size_t j) {
            return vertex(midpoint(v[i].node, v[j].node));
        };
        const auto stops = [&](const Vertex& x) { return block_.active[x.at] == 0; };
        const Vertex centre = middle(0, D);
        if (stops(centre)) {
            return leaf<0>(v, axes, 1);
        }
        const std::array<bool, 3> step{stops(middle(0, 1)), stops(middle(1, 2)),
                                       stops(middle(2, D))};
        if (!step[0] && !step[1] && !step[2]) {
            return;
        }
        const auto half = [&](std::size_t i, const Axes& own) {
            const Vertex face = middle(i, i + 2);
            if (stops(face)) {
                return leaf<1>({v[i], v[i + 1], v[i + 2], centre}, own, 1);
            }
            if (step[i]) {
                leaf<D - 1>({v[i], v[i + 1], face, centre}, own, 1);
            }
            if (step[i + 1]) {
                leaf<D - 1>({v[i + 1], v[i + 2], face, centre}, axes_of_second_half<D, 1>(own), 1);
            }
        };
        half(0, axes);
        half(1, axes_of_second_half<D, 0>(axes));
    }

    template <int Kind>
    void leaf(const Vertices& v, const Axes& axes, int level) {
        on_leaf_.template operator()<Kind>(v, axes, level);
    }

    const LocalBlock<Real, D>& block_;
    OnLeaf& on_leaf_;
};

// Processing of one block of an implicit grid: gathers its nodes and finds its leaves.

/// Data shared by all blocks of a pass over the grid.
template <class Real, int D>
struct BlockCommon {
    const NodeSet* nodes = nullptr;
    std::span<const Real> value;     ///< at the active nodes, of the function that is multiplied
    std::span<const Real> stopping;  ///< of the function whose gradient gives the coefficients
    TermsTable<Real, D> terms{};
    std::int64_t cells = 1;  ///< per block, along an axis
    int level = 0;           ///< of a block
    unsigned flat = 0;
    std::vector<ElementAxes<D>> walks;
};

/// The rows of nodes in an array of the block at a row of finest cells of one parity, as described
/// at BlockNodes::for_finest_cells. Row: NodeRow or SumRow.
template <class Row, int D, class Real>
std::array<Row, 4> corner_rows(Real* array, const std::array<std::uint32_t, 4>& first,
                               std::uint32_t parity) {
    std::array<Row, 4> rows;
    for (std::size_t r = 0; r < 4; ++r) {
        rows[r] = {array + first[r] + parity, array + first[r] + BlockLayout<D>::kEven};
    }
    return rows;
}

/// A thread's arrays, reused for one block after another.
template <bool HasValue, bool HasStopping, class Real, int D>
class BlockNodes {
  public:
    explicit BlockNodes(const BlockCommon<Real, D>& common) : common_(common), block(common.flat) {}

    /// Calls f(first, p, count) for each row along x: its position in the arrays, its first node.
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

    /// Calls f(y, z, first, parity, there) for each row of the finest cells at active nodes, for
    /// cells of one parity along x at a time: their position, the rows of nodes at them (by the
    /// parities of y (1) and z (2)) in the arrays, and 1 where a cell is in the volume. Three
    /// dimensions only.
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
                    // The one of the two nodes with this parity.
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

    /// Calls on_leaf for the leaves that for_finest_cells does not cover. `elements`: bits of this
    /// block's walks.
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
    /// Gathers a row in which all nodes are active.
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
