// AdaptTraverse: the recursive traversal of nested elements. It visits the elements of interest,
// stops where the error is small, and stores no element.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2:
//
//     AdaptTraverse(T):
//         if SimplexIsOfInterest(T):
//             if T is of the finest grid, or eta(x_ref(T)) < epsilon:    the stop test
//                 SimplexAction(T)
//             else:
//                 bisect T at x_ref(T) into T1 and T2
//                 AdaptTraverse(T1)
//                 AdaptTraverse(T2)
//
// Elements and the three parts are template types (Element<D> or Cell), so there is one
// implementation for one, two and three dimensions. Both tests are stateless functions of the
// element and of one number of its refinement node x_ref; they specify the field from which that
// number is read. So all elements around a node stop together, and a saturated field gives a mesh
// without hanging nodes. Leaves are passed to the action, which makes no decisions.
//
// This traversal is used for planes, cells with an error, whole domains, distances and tests;
// each_leaf.h runs it in parallel. Isosurfaces and slices of tetrahedra in volumes use the fast
// path (query/traverse/bricks/brick_traversal.h), which finds the same elements cube by cube;
// tests/traverse/adapt_traverse_test.cpp compares the two.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "query/march/clip.h"
#include "query/traverse/interest.h"
#include "store/base/vectors.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// The elements of nested grids in 1, 2 and 3 dimensions: edges, triangles and tetrahedra, which are
// bisected, and cells (squares, cubes), which are split in two along each axis.
//
// Source of the bisection: J. Maubach, "Local bisection refinement for n-simplicial grids generated
// by reflection", SIAM J. Sci. Comput. 16 (1995); section 2 of Gerstner, Rumpf, Weikard (2000).

template <int D>
struct Element;

/// The D! elements of the lattice's coarsest cube (square, edge), without values, in the order of
/// kAxisOrders. REQUIRES: lattice.dimension() == D.
template <int D>
std::vector<Element<D>> coarsest_elements(const Lattice& lattice);

/// A simplex of the nested grid with the values of U at its vertices. D bisections halve its size;
/// kind, which is less than D, counts those since the last whole cube (square, edge). For kind 0,
/// v0 -> v1 -> .. -> vD walks along the axes from the all-even corner of a cube of edge 2^level to
/// its all-odd corner. An element of kind k is half of one of kind k - 1. The refinement edge is v0
/// v(D - k).
template <int D>
struct Element {
    static_assert(D >= 1 && D <= 3);
    static constexpr std::size_t kVertices = D + 1;

    std::array<Int3, kVertices> v;          ///< nodes of the finest lattice
    std::array<double, kVertices> value{};  ///< NaN or infinite where U is missing
    int kind = 0;
    int level = 0;

    /// The coarsest elements, with their values.
    template <class Numbers>
    static std::vector<Element> coarsest(const Lattice& lattice, Numbers& numbers) {
        std::vector<Element> elements = coarsest_elements<D>(lattice);
        for (Element& t : elements) {
            for (std::size_t i = 0; i < kVertices; ++i) {
                t.value[i] = numbers.value(t.v[i], t.level);
            }
        }
        return elements;
    }
    /// Calls visit(child) for each child of this element. REQUIRES: level > 0.
    template <class Numbers, class Visit>
    void for_each_child(Numbers& numbers, const Visit& visit) const {
        for (const Element& half : bisect(numbers.value(ref_node(), level - 1))) {
            visit(half);
        }
    }
    /// Whether elements of its kind and level together fill a whole cube.
    [[nodiscard]] bool is_whole() const { return kind == 0; }

    [[nodiscard]] std::size_t ref_end() const { return static_cast<std::size_t>(D - kind); }
    /// Twice the midpoint of the refinement edge; also valid at level 0.
    [[nodiscard]] Int3 ref_node_twice() const { return v[0] + v[ref_end()]; }
    /// REQUIRES: level > 0.
    [[nodiscard]] Int3 ref_node() const {
        const Int3 twice = ref_node_twice();
        return {twice.x / 2, twice.y / 2, twice.z / 2};
    }
    /// The two halves. `middle`: U at the refinement node. REQUIRES: level > 0.
    [[nodiscard]] std::array<Element, 2> bisect(double middle) const {
        const std::size_t end = ref_end();
        std::array<Element, 2> halves{*this, *this};
        for (Element& half : halves) {
            half.v[end] = ref_node();
            half.value[end] = middle;
            half.kind = (kind + 1) % D;
            half.level = half.kind == 0 ? level - 1 : level;
        }
        for (std::size_t i = 0; i < end; ++i) {
            halves[1].v[i] = v[i + 1];
            halves[1].value[i] = value[i + 1];
        }
        return halves;
    }

    /// The corners of its bounding box.
    [[nodiscard]] std::pair<Int3, Int3> bounds() const {
        std::pair<Int3, Int3> box{v[0], v[0]};
        for (std::size_t i = 1; i < kVertices; ++i) {
            box.first = min(box.first, v[i]);
            box.second = max(box.second, v[i]);
        }
        return box;
    }
    [[nodiscard]] std::pair<double, double> range() const {
        const auto [low, high] = std::minmax_element(value.begin(), value.end());
        return {*low, *high};
    }
    /// Whether no value is missing.
    [[nodiscard]] bool is_complete() const {
        return std::all_of(value.begin(), value.end(), [](double u) { return std::isfinite(u); });
    }
    /// D! times its length, area or volume, in units of the finest lattice.
    [[nodiscard]] std::uint64_t size() const {
        return std::uint64_t{1} << static_cast<unsigned>(D * level - kind);
    }
};

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

/// A cell of the nested grid. Its refinement node is its centre. It stores no values.
struct Cell {
    int level = 0;
    Int3 at;      ///< low corner, in cells of its level
    Int3 extent;  ///< 1 along the axes of the grid, 0 along flat ones

    template <class Numbers>
    static std::vector<Cell> coarsest(const Lattice& lattice, Numbers& /*numbers*/) {
        return {{lattice.top(), {0, 0, 0}, min(lattice.nodes() - Int3{1, 1, 1}, {1, 1, 1})}};
    }
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
    template <class T>
    [[nodiscard]] static bool stops(const T& /*t*/, double /*eta*/) {
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
    template <class T>
    [[nodiscard]] bool stops(const T& t, double eta) const {
        return tolerance.stops(eta, t.ref_node_twice(), std::int64_t{1} << t.level);
    }
};

/// Source of the numbers at nodes: U at node p of the lattice of `level` or a coarser one, and a
/// field at a refinement node, both by coordinates of the finest lattice. May cache; one per
/// thread.
template <class Numbers>
concept NodeNumbers = requires(Numbers& numbers, const Int3& p, int level, Field field) {
    { numbers.value(p, level) } -> std::same_as<double>;
    { numbers.indicator(p, field) } -> std::same_as<double>;
};

/// Selects the elements that exist for the traversal; those outside are not visited.
template <class Region, class T>
concept RegionOf = requires(const Region& region, const T& t) {
    { region.overlap(t) } -> std::same_as<Overlap>;
};

/// SimplexIsOfInterest. `field()`: the field that the test needs at the refinement node; nothing if
/// it needs none. may_hold(t, number, numbers): `number` is that field's value, 0 if there is none
/// and at the finest level. For elements that do not store the values of U, the test may read U at
/// their corners from `numbers`.
template <class Test, class T, class Numbers>
concept InterestTest = requires(const Test& test, const T& t, double number, Numbers& numbers) {
    { test.field() } -> std::same_as<std::optional<Field>>;
    { test.may_hold(t, number, numbers) } -> std::same_as<bool>;
};

/// The stop test. `field()`: as above; if there is none, everything is refined to the finest level.
/// stops(t, eta) must be the same for all elements with the same refinement node.
template <class Test, class T>
concept IsStopTest = requires(const Test& test, const T& t, double eta) {
    { test.field() } -> std::same_as<std::optional<Field>>;
    { test.stops(t, eta) } -> std::same_as<bool>;
};

/// SimplexAction. action(leaf, eta, where): `eta` is the stop test's number, 0 at the finest level
/// or without a stop test; `where` is the leaf's position relative to the region.
template <class Action, class T>
concept SimplexAction = requires(Action& action, const T& leaf, double eta, Overlap where) {
    action(leaf, eta, where);
};

/// Statistics of a traversal.
struct VisitCounts {
    std::uint64_t visited = 0;   ///< elements tested by SimplexIsOfInterest
    std::uint64_t leaves = 0;    ///< elements passed to SimplexAction
    std::uint64_t finished = 0;  ///< sum of size() of all elements that are finished

    void add(const VisitCounts& other) {
        visited += other.visited;
        leaves += other.leaves;
        finished += other.finished;
    }
};

/// See the top of this file. Children are visited in the order of T::for_each_child(). One instance
/// per thread.
template <class T, NodeNumbers Numbers, RegionOf<T> Region, InterestTest<T, Numbers> Interest,
          IsStopTest<T> Stop>
class AdaptTraverse {
  public:
    AdaptTraverse(Numbers& numbers, const Region& region, const Interest& interest,
                  const Stop& stop)
        : numbers_(numbers), region_(region), interest_(interest), stop_(stop) {}

    /// The coarsest elements.
    [[nodiscard]] std::vector<T> roots(const Lattice& lattice) {
        return T::coarsest(lattice, numbers_);
    }
    /// AdaptTraverse(t).
    void subtree(const T& t, SimplexAction<T> auto& action) { visit(t, action, nullptr); }
    /// The same, but only down to whole elements of `level`; those are added to `left`, unvisited.
    void above(const T& t, int level, SimplexAction<T> auto& action, std::vector<T>& left) {
        level_of_left_ = level;
        visit(t, action, &left);
    }
    [[nodiscard]] const VisitCounts& counts() const { return counts_; }

  private:
    void visit(const T& t, SimplexAction<T> auto& action, std::vector<T>* left) {
        if (left != nullptr && t.level == level_of_left_ && t.is_whole()) {
            left->push_back(t);
            return;
        }
        const Overlap where = region_.overlap(t);
        if (where == Overlap::outside) {
            counts_.finished += t.size();
            return;
        }
        ++counts_.visited;
        const bool finest = t.level == 0;
        const std::optional<Field> asked = finest ? std::nullopt : interest_.field();
        const double number = asked ? numbers_.indicator(t.ref_node(), *asked) : 0;
        if (!interest_.may_hold(t, number, numbers_)) {
            counts_.finished += t.size();
            return;
        }
        double eta = 0;
        bool is_leaf = finest;
        if (const auto field = stop_.field(); field && !finest) {
            eta = field == asked ? number : numbers_.indicator(t.ref_node(), *field);
            is_leaf = stop_.stops(t, eta);
        }
        if (is_leaf) {
            ++counts_.leaves;
            counts_.finished += t.size();
            action(t, eta, where);
            return;
        }
        t.for_each_child(numbers_, [&](const T& child) { visit(child, action, left); });
    }

    Numbers& numbers_;
    Region region_;
    Interest interest_;
    Stop stop_;
    VisitCounts counts_;
    int level_of_left_ = 0;
};

}  // namespace isonest::detail
