// The leaves of an implicit grid in memory, as found by AdaptTraverse.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 7. Refinement stops at a node that is not
// active. Elements that extend beyond the volume are refined (their nodes are active, or outside),
// and those outside are not visited, so every leaf is in the volume.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "query/finite_elements/active_nodes.h"
#include "query/traverse/adapt_traverse.h"

namespace isonest::detail {

/// NodeNumbers: 1 at refined nodes, 0 elsewhere; values of a function are not used.
class ActiveNumbers {
  public:
    explicit ActiveNumbers(const NodeSet& set) : set_(&set), last_(set.nodes() - Int3{1, 1, 1}) {}
    [[nodiscard]] static double value(const Int3& /*p*/, int /*level*/) { return 0; }
    [[nodiscard]] double indicator(const Int3& p, Field /*field*/) const {
        return max(p, last_) != last_ || set_->contains(p) ? 1 : 0;
    }

  private:
    const NodeSet* set_;
    Int3 last_;
};

/// IsStopTest.
struct StopsAtInactive {
    [[nodiscard]] static std::optional<Field> field() { return Field::values; }
    template <int D, class Numbers>
    [[nodiscard]] static bool stops(const Element<D>& /*t*/, double active, Numbers& /*numbers*/) {
        return active == 0;
    }
};

/// RegionOf: elements outside have no interior point in common with the volume.
struct WithinVolume {
    Int3 last;  ///< the last node

    template <int D>
    [[nodiscard]] Overlap overlap(const Element<D>& t) const {
        const auto [low, high] = t.bounds();
        Overlap found = Overlap::inside;
        for (int axis = 0; axis < 3; ++axis) {
            if (high[axis] > last[axis]) {
                if (low[axis] >= last[axis]) {
                    return Overlap::outside;
                }
                found = Overlap::crossing;
            }
        }
        return found;
    }
};

template <int D>
using GridTraverse =
    AdaptTraverse<Element<D>, ActiveNumbers, WithinVolume, Everything, StopsAtInactive>;

/// The axes of an element in its own order: see linear_element.h.
template <int D>
std::array<int, static_cast<std::size_t>(D)> axes_of(const Element<D>& t) {
    std::array<int, static_cast<std::size_t>(D)> axes{};
    const auto axis_of = [](const Int3& step) { return step.x != 0 ? 0 : step.y != 0 ? 1 : 2; };
    // The steps of the walk, then the remaining ones, with the earlier midpoint last.
    const std::size_t steps = t.ref_end();
    unsigned left = 7;
    for (std::size_t i = 0; i < steps; ++i) {
        axes.at(i) = axis_of(t.v[i + 1] - t.v[i]);
        left &= ~(1U << static_cast<unsigned>(axes.at(i)));
    }
    if constexpr (D == 2) {
        if (steps == 1) {
            // The opposite vertex is a half step away from the edge, along the other axis only.
            const Int3 across = t.v[2] + t.v[2] - t.v[0] - t.v[1];
            axes[1] = axis_of(across);
        }
    } else if constexpr (D == 3) {
        if (steps == 1) {
            const Int3 across = t.v[2] + t.v[2] - t.v[0] - t.v[1];
            axes[1] = axis_of(across);
            left &= ~(1U << static_cast<unsigned>(axes[1]));
        }
        if (steps < 3) {
            axes[2] = std::countr_zero(left);
        }
    }
    return axes;
}

/// The axes of the walks of a cube's elements of kind 0, in the order of coarsest_elements().
/// REQUIRES: lattice.dimension() == D.
template <int D>
std::vector<std::array<int, static_cast<std::size_t>(D)>> axis_orders(const Lattice& lattice) {
    std::vector<std::array<int, static_cast<std::size_t>(D)>> orders;
    for (const Element<D>& t : coarsest_elements<D>(lattice)) {
        orders.push_back(axes_of(t));
    }
    return orders;
}

// The implicit grid as a mesh: every leaf with the numbers of its nodes, and two ways to number
// them.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7: "no element is stored; nodes are an array, or
// a hash table", where the key of a new node is the pair of the numbers of its parents, the ends of
// its refinement edge. The table's memory depends on the active nodes, not on the lattice's size.

/// A map from nodes to unknowns. corner(p) is called for each corner of the coarsest elements,
/// middle(a, b, p) for a node p halfway between those numbered a and b; repeated calls must return
/// the same result.
template <class Numbering>
concept NodeNumbering = requires(Numbering& n, const Int3& p, std::uint64_t a) {
    { n.corner(p) } -> std::same_as<std::uint64_t>;
    { n.middle(a, a, p) } -> std::same_as<std::uint64_t>;
};

/// The array: a node's number is its index in the lattice.
class LatticeNumbering {
  public:
    explicit LatticeNumbering(const Int3& nodes) : nodes_(nodes) {}
    [[nodiscard]] std::uint64_t corner(const Int3& p) const {
        return static_cast<std::uint64_t>(nodes_.linear(p));
    }
    [[nodiscard]] std::uint64_t middle(std::uint64_t /*a*/, std::uint64_t /*b*/,
                                       const Int3& p) const {
        return corner(p);
    }

  private:
    Int3 nodes_;
};

/// The argument of an action.
template <int D>
struct NumberedElement {
    Element<D> simplex;  ///< its vertices and level; values are 0
    std::array<std::uint64_t, static_cast<std::size_t>(D) + 1> node{};
};

/// AdaptTraverse over the whole domain, one element after another: action(const
/// NumberedElement<D>&) for each leaf. refines(t) must be the same for all elements that share a
/// refinement node, and saturated; it is not called at the finest level. `region`: everything
/// outside is skipped. REQUIRES: lattice.dimension() == D.
template <int D, RegionOf<Element<D>> Region, class Refines, NodeNumbering Numbering, class Action>
void for_each_element(const Lattice& lattice, const Region& region, const Refines& refines,
                      Numbering& numbering, const Action& action) {
    const auto visit = [&](const auto& self, const NumberedElement<D>& t) -> void {
        if (region.overlap(t.simplex) == Overlap::outside) {
            return;
        }
        if (t.simplex.level == 0 || !refines(t.simplex)) {
            action(t);
            return;
        }
        // GCC 14 does not see that ref_end() <= D, and warns about the arrays' bounds.
        const std::size_t end = std::min<std::size_t>(t.simplex.ref_end(), D);
        const std::uint64_t middle = numbering.middle(t.node[0], t.node[end], t.simplex.ref_node());
        const auto halves = t.simplex.bisect(0);
        NumberedElement<D> half{halves[0], t.node};
        half.node[end] = middle;
        self(self, half);
        half.simplex = halves[1];
        for (std::size_t i = 0; i < end; ++i) {
            half.node[i] = t.node[i + 1];
        }
        self(self, half);
    };
    for (const Element<D>& root : coarsest_elements<D>(lattice)) {
        NumberedElement<D> t{root, {}};
        for (std::size_t i = 0; i < t.node.size(); ++i) {
            t.node[i] = numbering.corner(root.v[i]);
        }
        visit(visit, t);
    }
}

}  // namespace isonest::detail
