// The leaves of an implicit grid in memory, as AdaptTraverse finds them.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 7. A node stops the refinement where it
// is not active. Elements that reach out of the volume go on (their nodes are active, or outside),
// and those outside are not visited, so every leaf lies in the volume.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <optional>
#include <vector>

#include "query/finite_elements/node_set.h"
#include "query/traverse/adapt_traverse.h"
#include "query/traverse/element_tests.h"

namespace isonest::detail {

/// NodeNumbers: 1 at what is refined, 0 elsewhere; a function's values are not asked for.
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
    template <int D>
    [[nodiscard]] static bool stops(const Element<D>& /*t*/, double active) {
        return active == 0;
    }
};

/// RegionOf: elements outside have no inner point in common with the volume.
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
using GridTraverse = AdaptTraverse<D, ActiveNumbers, WithinVolume, Everything, StopsAtInactive>;

/// The axes of an element in its own order: see linear_element.h.
template <int D>
std::array<int, static_cast<std::size_t>(D)> axes_of(const Element<D>& t) {
    std::array<int, static_cast<std::size_t>(D)> axes{};
    const auto axis_of = [](const Int3& step) { return step.x != 0 ? 0 : step.y != 0 ? 1 : 2; };
    // The steps of the walk; the others are what is left, the earlier midpoint last.
    const std::size_t steps = t.ref_end();
    unsigned left = 7;
    for (std::size_t i = 0; i < steps; ++i) {
        axes.at(i) = axis_of(t.v[i + 1] - t.v[i]);
        left &= ~(1U << static_cast<unsigned>(axes.at(i)));
    }
    if constexpr (D == 2) {
        if (steps == 1) {
            // The vertex across is a half step away from the edge, along the other axis alone.
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

/// The axes along which the walks of a cube's elements of kind 0 go, in the order of
/// coarsest_elements(). REQUIRES: lattice.dimension() == D.
template <int D>
std::vector<std::array<int, static_cast<std::size_t>(D)>> axis_orders(const Lattice& lattice) {
    std::vector<std::array<int, static_cast<std::size_t>(D)>> orders;
    for (const Element<D>& t : coarsest_elements<D>(lattice)) {
        orders.push_back(axes_of(t));
    }
    return orders;
}

}  // namespace isonest::detail
