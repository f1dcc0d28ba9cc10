// Elements, regions and tests of AdaptTraverse within the library; the recursion itself is in
// <isonest/traverse.h>.
//
// Elements and the three parts are template types (Element<D> or Cell), so there is one
// implementation for one, two and three dimensions. Each test specifies the field of which it needs
// the number at the refinement node, so that a number that both need is read once.
//
// This traversal is used for planes, cells with an error, whole domains, distances, the caller's
// functions and tests; each_leaf.h and query/extract/traverse_parts.cpp run it in parallel.
// Isosurfaces and slices of tetrahedra in volumes use the fast path
// (query/traverse/bricks/brick_traversal.h), which finds the same elements cube by cube;
// tests/traverse/adapt_traverse_test.cpp compares the two.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/element.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/traverse.h>

#include "query/march/clip.h"
#include "query/traverse/interest.h"
#include "store/base/vectors.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// The elements of nested grids in 1, 2 and 3 dimensions: edges, triangles and tetrahedra
// (isonest/element.h), which are bisected, and cells (squares, cubes), which are split in two along
// each axis.

/// The D! elements of the lattice's coarsest cube (square, edge), without values, in the order of
/// kAxisOrders. REQUIRES: lattice.dimension() == D.
template <int D>
std::vector<Element<D>> coarsest_elements(const Lattice& lattice) {
    std::array<int, D> axes{};
    std::size_t count = 0;
    for (int axis = 0; axis < 3; ++axis) {
        if (lattice.nodes()[axis] > 1) {
            axes.at(count++) = axis;
        }
    }
    std::vector<Element<D>> elements;
    do {
        Element<D> t;
        t.level = lattice.top();
        for (std::size_t i = 0; i < D; ++i) {
            t.v[i + 1] = t.v[i];
            t.v[i + 1][axes[i]] = std::int64_t{1} << lattice.top();
        }
        elements.push_back(t);
    } while (std::next_permutation(axes.begin(), axes.end()));
    return elements;
}

/// The same with their values.
template <int D, class Numbers>
std::vector<Element<D>> coarsest_of(const Lattice& lattice, Numbers& numbers,
                                    std::type_identity<Element<D>> /*type*/) {
    std::vector<Element<D>> elements = coarsest_elements<D>(lattice);
    for (Element<D>& t : elements) {
        for (std::size_t i = 0; i < t.v.size(); ++i) {
            t.value[i] = numbers.value(t.v[i], t.level);
        }
    }
    return elements;
}

/// A cell of the nested grid. Its refinement node is its centre. It stores no values.
struct Cell {
    int level = 0;
    Int3 at;      ///< low corner, in cells of its level
    Int3 extent;  ///< 1 along the axes of the grid, 0 along flat ones

    template <class Numbers, class Visit>
    void for_each_child(Numbers& /*numbers*/, const Visit& visit) const {
        const Int3 children = extent + Int3{1, 1, 1};
        for (std::int64_t i = 0; i < children.product(); ++i) {
            visit(Cell{level - 1, at * 2 + children.unlinear(i), extent});
        }
    }
    [[nodiscard]] static bool is_whole() { return true; }

    [[nodiscard]] std::int64_t edge() const { return std::int64_t{1} << level; }
    [[nodiscard]] Int3 low() const { return at * edge(); }
    [[nodiscard]] Int3 ref_node_twice() const { return (at * 2 + extent) * edge(); }
    /// REQUIRES: level > 0.
    [[nodiscard]] Int3 ref_node() const { return (at * 2 + extent) * (edge() / 2); }
    [[nodiscard]] std::pair<Int3, Int3> bounds() const { return {low(), low() + extent * edge()}; }
    /// Its length, area or volume, in units of the finest lattice.
    [[nodiscard]] std::uint64_t size() const {
        return std::uint64_t{1} << static_cast<unsigned>((extent.x + extent.y + extent.z) * level);
    }
};

template <class Numbers>
std::vector<Cell> coarsest_of(const Lattice& lattice, Numbers& /*numbers*/,
                              std::type_identity<Cell> /*type*/) {
    return {{lattice.top(), {0, 0, 0}, min(lattice.nodes() - Int3{1, 1, 1}, {1, 1, 1})}};
}

// Regions, interest tests and stop tests of AdaptTraverse.

/// Selects the elements whose bounding boxes overlap a box.
struct InBox {
    ClipBox box;  ///< infinite along axes without extent

    template <class T>
    [[nodiscard]] Overlap overlap(const T& t) const {
        const auto [low, high] = t.bounds();
        return overlap_of(box, low, high);
    }
};

/// The bounding box of the whole volume.
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

/// Accepts every element.
struct Everything {
    [[nodiscard]] static std::optional<Field> field() { return std::nullopt; }
    template <class T, class Numbers>
    [[nodiscard]] static bool may_hold(const T& /*t*/, double /*number*/, Numbers& /*numbers*/) {
        return true;
    }
};

/// Selects elements in which the finest function may take the isovalue (section 5 of the paper,
/// beta_0): it stays within the values at the vertices plus or minus the bound.
struct HoldsIsovalue {
    double iso = 0;
    Field bound = Field::deviation_bar;  ///< REQUIRES: is_bound(bound)
    LatticeSteps steps = {};

    [[nodiscard]] std::optional<Field> field() const { return bound; }
    template <int D, class Numbers>
    [[nodiscard]] bool may_hold(const Element<D>& t, double number, Numbers& /*numbers*/) const {
        const auto [low, high] = t.range();
        return may_reach(low, high, number * bound_scale(bound, t.level, steps), iso);
    }
};

/// Refines everything down to the finest level.
struct NothingStops {
    [[nodiscard]] static std::optional<Field> field() { return std::nullopt; }
    template <class T, class Numbers>
    [[nodiscard]] static bool stops(const T& /*t*/, double /*eta*/, Numbers& /*numbers*/) {
        return false;
    }
};

/// Stops at a node whose field is below a tolerance, which may depend on the position.
struct StopsBelow {
    Tolerance tolerance;
    Field stop = Field::deviation_bar;

    [[nodiscard]] std::optional<Field> field() const {
        return tolerance.is_zero() ? std::nullopt : std::optional(stop);
    }
    template <class T, class Numbers>
    [[nodiscard]] bool stops(const T& t, double eta, Numbers& /*numbers*/) const {
        return field() && tolerance.stops(eta, t.ref_node_twice(), std::int64_t{1} << t.level);
    }
};

}  // namespace isonest::detail
