// The implicit grid as a mesh: every leaf with the numbers of its nodes, and two ways to number
// them.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7: "no element is stored; nodes are an array, or
// a hash table", whose key for a new node is the pair of the numbers of its parents, the ends of
// its refinement edge. The table's memory follows the active nodes, whatever the lattice's size.
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <concepts>
#include <cstdint>
#include <utility>
#include <vector>

#include "query/finite_elements/node_set.h"
#include "query/traverse/adapt_traverse.h"

namespace isonest::detail {

/// A map from nodes to unknowns. corner(p) is asked for each corner of the coarsest elements,
/// middle(a, b, p) for a node p halfway between those numbered a and b; the answers are the same
/// whenever they are asked.
template <class Numbering>
concept NodeNumbering = requires(Numbering& n, const Int3& p, std::uint64_t a) {
    { n.corner(p) } -> std::same_as<std::uint64_t>;
    { n.middle(a, a, p) } -> std::same_as<std::uint64_t>;
};

/// The array: a node's number is its place on the lattice.
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

/// The hash table: numbers in the order in which nodes are met, from 0. Thread-safety: one thread.
class HashedNumbering {
  public:
    std::uint64_t corner(const Int3& p) {
        // No pair of numbers has a first one so large.
        constexpr std::uint64_t kCorner = std::uint64_t{1} << 63U;
        const auto place = static_cast<std::uint64_t>((p.x != 0 ? 1 : 0) + (p.y != 0 ? 2 : 0) +
                                                      (p.z != 0 ? 4 : 0));
        return number({kCorner, place});
    }
    std::uint64_t middle(std::uint64_t a, std::uint64_t b, const Int3& /*p*/) {
        return number(std::minmax(a, b));
    }
    /// How many nodes were met.
    [[nodiscard]] std::uint64_t count() const { return numbers_.size(); }
    /// Bytes that the table holds.
    [[nodiscard]] std::uint64_t heap() const {
        // A bucket is the entry and how far it is from where it belongs.
        return numbers_.bucket_count() * (sizeof(Map::value_type) + sizeof(std::uint64_t));
    }

  private:
    using Pair = std::pair<std::uint64_t, std::uint64_t>;
    struct Hash {
        std::size_t operator()(const Pair& p) const {
            std::uint64_t h = p.first * 0x9E3779B97F4A7C15U + p.second;
            h = (h ^ (h >> 30U)) * 0xBF58476D1CE4E5B9U;
            return h ^ (h >> 29U);
        }
    };
    using Map = tsl::robin_map<Pair, std::uint64_t, Hash>;
    std::uint64_t number(const Pair& parents) {
        return numbers_.try_emplace(parents, numbers_.size()).first->second;
    }

    Map numbers_;
};

/// What an action gets.
template <int D>
struct NumberedElement {
    Element<D> simplex;  ///< its vertices and level; values are 0
    std::array<std::uint64_t, static_cast<std::size_t>(D) + 1> node{};
};

/// AdaptTraverse over the whole domain, one element after the other: action(const
/// NumberedElement<D>&) for each leaf. refines(t) is the same for all elements that share a
/// refinement node, and saturated; not asked at the finest level. `region`: what lies outside is
/// left out. REQUIRES: lattice.dimension() == D.
template <int D, RegionOf<D> Region, class Refines, NodeNumbering Numbering, class Action>
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
        const std::size_t end = t.simplex.ref_end();
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
