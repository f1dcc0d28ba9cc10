// AdaptTraverse within one block: the leaves of an implicit grid.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 7. The refinement node of an element is
// the midpoint of two vertices, so nothing but their places is carried down; the stop test is one
// number of the block's array. In space the finest elements are left to finest_cells.h.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "query/finite_elements/finest_cells.h"
#include "query/finite_elements/linear_element.h"
#include "query/finite_elements/local_block.h"

namespace isonest::detail {

/// What the elements of one kind and level have in common.
template <class Real>
struct ElementTerms {
    Real volume = 0;
    Real stiffness = 0;             ///< factor times volume
    std::array<Real, 3> inverse{};  ///< 1 / (edge length)^2 by axis
    Real inverse_lambda = 0;        ///< 1 / lambda^2
};

/// Adds one leaf's part. `inverse`: along its own axes.
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

/// By kind and level.
template <class Real, int D>
using TermsTable = std::array<std::array<ElementTerms<Real>, static_cast<std::size_t>(D)>, 32>;

template <int D>
using ElementAxes = std::array<int, static_cast<std::size_t>(D)>;

/// A vertex of an element in a block: which node, and where it lies in the block's arrays.
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

    /// All leaves of an element of kind 0 of the block: the walk along `axes` from the corner
    /// `even`, which is 0 or `cells` along each axis.
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
    /// How an element lies to the volume.
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
    /// in the middle of two faces, their halves at those in the middle of the walk's three steps.
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

}  // namespace isonest::detail
