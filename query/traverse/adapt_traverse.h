// AdaptTraverse: the recursive traversal of nested simplices that visits what is of interest, stops
// where the error is small, and stores no element.
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
// The three parts are types. Both tests are functions of the element and of one number that belongs
// to its refinement node x_ref, have no state, and say of which field that number is; so all
// elements around a node stop together, and a saturated field makes a mesh without hanging nodes.
// What is found goes to the action, which decides nothing.
//
// This is the traversal of planes, of whole domains and of tests. Isosurfaces and slices of volumes
// larger than memory take the fast path (query/traverse/bricks/brick_traversal.h), which finds the
// same elements by cubes; tests/traverse/adapt_traverse_test.cpp holds both against each other.
#pragma once

#include <concepts>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/field.h>

#include "query/march/clip.h"
#include "query/traverse/element.h"

namespace isonest::detail {

/// Where the numbers of nodes come from: U at node p, of the lattice of `level` or a coarser one,
/// and a field at a refinement node, both by coordinates of the finest lattice. May cache: one per
/// thread.
template <class Numbers>
concept NodeNumbers = requires(Numbers& numbers, const Int3& p, int level, Field field) {
    { numbers.value(p, level) } -> std::same_as<double>;
    { numbers.indicator(p, field) } -> std::same_as<double>;
};

/// Which elements there are at all. Those outside are not visited.
template <class Region, int D>
concept RegionOf = requires(const Region& region, const Element<D>& t) {
    { region.overlap(t) } -> std::same_as<Overlap>;
};

/// SimplexIsOfInterest. `field()`: what the test asks of the refinement node; nothing if it needs
/// no number. may_hold(t, number): the number is 0 if none is asked and at the finest level.
template <class Test, int D>
concept InterestTest = requires(const Test& test, const Element<D>& t, double number) {
    { test.field() } -> std::same_as<std::optional<Field>>;
    { test.may_hold(t, number) } -> std::same_as<bool>;
};

/// The stop test. `field()`: as above; if there is none, nothing stops above the finest level.
/// stops(t, eta) is the same for all elements with one refinement node.
template <class Test, int D>
concept IsStopTest = requires(const Test& test, const Element<D>& t, double eta) {
    { test.field() } -> std::same_as<std::optional<Field>>;
    { test.stops(t, eta) } -> std::same_as<bool>;
};

/// SimplexAction. action(leaf, eta, where): eta is the stop test's number, 0 at the finest level or
/// if there is no stop test; `where` is how the leaf lies to the region.
template <class Action, int D>
concept SimplexAction = requires(Action& action, const Element<D>& leaf, double eta,
                                 Overlap where) {
    action(leaf, eta, where);
};

/// What a traversal did.
struct VisitCounts {
    std::uint64_t visited = 0;   ///< elements that SimplexIsOfInterest was asked about
    std::uint64_t leaves = 0;    ///< elements that SimplexAction got
    std::uint64_t finished = 0;  ///< Element::size(), summed over what will not be visited again

    void add(const VisitCounts& other) {
        visited += other.visited;
        leaves += other.leaves;
        finished += other.finished;
    }
};

/// See the top of this file. Children are visited in the order of Element::bisect(). One per
/// thread.
template <int D, NodeNumbers Numbers, RegionOf<D> Region, InterestTest<D> Interest,
          IsStopTest<D> Stop>
class AdaptTraverse {
  public:
    AdaptTraverse(Numbers& numbers, const Region& region, const Interest& interest,
                  const Stop& stop)
        : numbers_(numbers), region_(region), interest_(interest), stop_(stop) {}

    /// The coarsest elements with their values.
    [[nodiscard]] std::vector<Element<D>> roots(const Lattice& lattice) {
        std::vector<Element<D>> elements = coarsest_elements<D>(lattice);
        for (Element<D>& t : elements) {
            for (std::size_t i = 0; i < t.v.size(); ++i) {
                t.value[i] = numbers_.value(t.v[i], t.level);
            }
        }
        return elements;
    }
    /// AdaptTraverse(t).
    void subtree(const Element<D>& t, SimplexAction<D> auto& action) { visit(t, action, nullptr); }
    /// The same down to elements of kind 0 and of `level`: those are left, unvisited, to others.
    void above(const Element<D>& t, int level, SimplexAction<D> auto& action,
               std::vector<Element<D>>& left) {
        level_of_left_ = level;
        visit(t, action, &left);
    }
    [[nodiscard]] const VisitCounts& counts() const { return counts_; }

  private:
    void visit(const Element<D>& t, SimplexAction<D> auto& action, std::vector<Element<D>>* left) {
        if (left != nullptr && t.kind == 0 && t.level == level_of_left_) {
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
        if (!interest_.may_hold(t, number)) {
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
        for (const Element<D>& half : t.bisect(numbers_.value(t.ref_node(), t.level - 1))) {
            visit(half, action, left);
        }
    }

    Numbers& numbers_;
    Region region_;
    Interest interest_;
    Stop stop_;
    VisitCounts counts_;
    int level_of_left_ = 0;
};

}  // namespace isonest::detail
