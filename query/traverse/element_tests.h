// Regions, interest tests and stop tests of AdaptTraverse.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include <isonest/field.h>

#include "query/march/clip.h"
#include "query/traverse/element.h"
#include "query/traverse/interest.h"
#include "query/traverse/tolerance.h"

namespace isonest::detail {

/// The elements whose bounding boxes reach into a box.
struct InBox {
    ClipBox box;  ///< infinite along axes without extent

    template <int D>
    [[nodiscard]] Overlap overlap(const Element<D>& t) const {
        const auto [low, high] = t.bounds();
        return overlap_of(box, low, high);
    }
};

/// The box of a whole volume.
inline ClipBox volume_box(const Lattice& lattice) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    ClipBox box;
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t last = lattice.nodes()[axis] - 1;
        box.lo[static_cast<std::size_t>(axis)] = last == 0 ? -kInfinity : 0;
        box.hi[static_cast<std::size_t>(axis)] = last == 0 ? kInfinity : static_cast<double>(last);
    }
    return box;
}

/// All is of interest.
struct Everything {
    [[nodiscard]] static std::optional<Field> field() { return std::nullopt; }
    template <int D>
    [[nodiscard]] static bool may_hold(const Element<D>& /*t*/, double /*number*/) {
        return true;
    }
};

/// Where the finest function may take the isovalue (section 5 of the paper, beta_0): it stays
/// within the values of the vertices plus or minus the bound.
struct HoldsIsovalue {
    double iso = 0;
    Field bound = Field::deviation_bar;  ///< REQUIRES: is_bound(bound)
    Double3 spacing{1, 1, 1};

    [[nodiscard]] std::optional<Field> field() const { return bound; }
    template <int D>
    [[nodiscard]] bool may_hold(const Element<D>& t, double number) const {
        const auto [low, high] = t.range();
        return may_reach(low, high, number * bound_scale(bound, t.level, spacing), iso);
    }
};

/// Nothing stops above the finest level.
struct NothingStops {
    [[nodiscard]] static std::optional<Field> field() { return std::nullopt; }
    template <int D>
    [[nodiscard]] static bool stops(const Element<D>& /*t*/, double /*eta*/) {
        return false;
    }
};

/// A node stops where its field is below a tolerance, which may depend on the place.
struct StopsBelow {
    Tolerance tolerance;
    Field stop = Field::deviation_bar;

    [[nodiscard]] std::optional<Field> field() const {
        return tolerance.is_zero() ? std::nullopt : std::optional(stop);
    }
    template <int D>
    [[nodiscard]] bool stops(const Element<D>& t, double eta) const {
        return tolerance.stops(eta, t.ref_node_twice(), std::int64_t{1} << t.level);
    }
};

}  // namespace isonest::detail
