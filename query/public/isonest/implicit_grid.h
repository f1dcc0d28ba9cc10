// Adaptive grids that are not stored: nodes, their numbers, and the elements between them.
//
// Source: T. Gerstner, M. Rumpf, U. Weikard, "Error Indicators for Multilevel Visualization and
// Computing on Nested Grids", Computers & Graphics 24 (2000), section 7. The refined nodes
// determine which elements the recursive bisection finds; nodes are numbered by an array or by a
// hash table.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>

namespace isonest {
namespace detail {
template <int D>
struct GridParts;
}

/// A set of nodes of a lattice. Once it is finished, each has a number: its position among them, x
/// fastest. Takes 12 bytes for 64 nodes of the lattice, and 8 bytes for each row. Thread-safety:
/// const methods from any thread; also insert() and row_words() of different rows.
class NodeSet {
  public:
    NodeSet() = default;
    explicit NodeSet(const Int3& nodes)
        : nodes_(nodes),
          words_per_row_(ceil_div(nodes.x, kBits)),
          words_(static_cast<std::size_t>(words_per_row_ * nodes.y * nodes.z)),
          before_(words_.size()),
          first_(static_cast<std::size_t>(nodes.y * nodes.z) + 1) {}

    /// Nodes per axis of the lattice.
    [[nodiscard]] const Int3& nodes() const { return nodes_; }
    /// REQUIRES for everything that takes a node: 0 <= p < nodes().
    [[nodiscard]] bool contains(const Int3& p) const { return (word(p) >> bit(p.x) & 1U) != 0; }
    void insert(const Int3& p) { words_[index(p)] |= std::uint64_t{1} << bit(p.x); }

    /// The bits of a row along x, 64 per word.
    [[nodiscard]] std::span<std::uint64_t> row_words(std::int64_t y, std::int64_t z) {
        return {words_.data() + index({0, y, z}), static_cast<std::size_t>(words_per_row_)};
    }
    [[nodiscard]] std::span<const std::uint64_t> row_words(std::int64_t y, std::int64_t z) const {
        return {words_.data() + index({0, y, z}), static_cast<std::size_t>(words_per_row_)};
    }

    /// Numbers the nodes. REQUIRES: no insert() afterwards.
    void finish() {
        std::uint64_t count = 0;
        for (std::size_t row = 0; row + 1 < first_.size(); ++row) {
            first_[row] = count;
            std::uint32_t in_row = 0;
            for (std::int64_t w = 0; w < words_per_row_; ++w) {
                const auto i =
                    row * static_cast<std::size_t>(words_per_row_) + static_cast<std::size_t>(w);
                before_[i] = in_row;
                in_row += static_cast<std::uint32_t>(std::popcount(words_[i]));
            }
            count += in_row;
        }
        first_.back() = count;
    }
    /// Number of nodes in the set. REQUIRES, also for everything below: finished.
    [[nodiscard]] std::uint64_t count() const { return first_.back(); }
    [[nodiscard]] bool is_full() const {
        return count() == static_cast<std::uint64_t>(nodes_.product());
    }
    /// The number of a node in the set.
    [[nodiscard]] std::uint64_t number(const Int3& p) const {
        assert(contains(p));
        return number_from(p);
    }
    /// Number of nodes of the set before p.
    [[nodiscard]] std::uint64_t number_from(const Int3& p) const {
        const std::uint64_t lower = (std::uint64_t{1} << bit(p.x)) - 1;
        const std::size_t i = index(p);
        return first_[row(p)] + before_[i] +
               static_cast<std::uint64_t>(std::popcount(words_[i] & lower));
    }
    /// Calls f(x, number) for the set's nodes among `count` nodes starting at p along x, in
    /// ascending order.
    template <class F>
    void for_row(const Int3& p, std::int64_t count, const F& f) const {
        std::uint64_t number = number_from(p);
        const std::int64_t end = p.x + count;
        for (std::int64_t x = p.x; x < end;) {
            const std::int64_t left = std::min<std::int64_t>(kBits - bit(x), end - x);
            std::uint64_t bits = words_[index({x, p.y, p.z})] >> bit(x);
            if (left < kBits) {
                bits &= (std::uint64_t{1} << static_cast<unsigned>(left)) - 1;
            }
            for (; bits != 0; bits &= bits - 1) {
                f(x + std::countr_zero(bits), number++);
            }
            x += left;
        }
    }
    /// Calls f(p, number) for all nodes, in ascending order of the numbers.
    template <class F>
    void for_each(const F& f) const {
        for (std::int64_t row = 0; row < nodes_.y * nodes_.z; ++row) {
            const Int3 first{0, row % nodes_.y, row / nodes_.y};
            for_row(first, nodes_.x, [&](std::int64_t x, std::uint64_t number) {
                f(Int3{x, first.y, first.z}, static_cast<std::size_t>(number));
            });
        }
    }
    /// Whether the set contains all `count` nodes starting at p along x. REQUIRES: count <= 64.
    [[nodiscard]] bool contains_row(const Int3& p, std::int64_t count) const {
        const std::int64_t left = std::min<std::int64_t>(kBits - bit(p.x), count);
        const std::uint64_t bits = words_[index(p)] >> bit(p.x);
        return static_cast<std::int64_t>(std::countr_one(bits)) >= left &&
               (left == count || contains_row({p.x + left, p.y, p.z}, count - left));
    }
    /// Size in bytes.
    [[nodiscard]] std::uint64_t heap() const {
        return words_.size() * (sizeof(std::uint64_t) + sizeof(std::uint32_t)) +
               first_.size() * sizeof(std::uint64_t);
    }

  private:
    static constexpr std::int64_t kBits = 64;
    static unsigned bit(std::int64_t x) { return static_cast<unsigned>(x % kBits); }
    [[nodiscard]] std::size_t row(const Int3& p) const {
        return static_cast<std::size_t>(p.y + nodes_.y * p.z);
    }
    [[nodiscard]] std::size_t index(const Int3& p) const {
        return row(p) * static_cast<std::size_t>(words_per_row_) +
               static_cast<std::size_t>(p.x / kBits);
    }
    [[nodiscard]] std::uint64_t word(const Int3& p) const { return words_[index(p)]; }

    Int3 nodes_{0, 0, 0};
    std::int64_t words_per_row_ = 0;
    std::vector<std::uint64_t> words_;
    std::vector<std::uint32_t> before_;    ///< in the row, before each word
    std::vector<std::uint64_t> first_{0};  ///< number of each row's first node, and their count
};

/// The hash table: the key of a node is the pair of the numbers of its parents, the ends of its
/// refinement edge; its value is the next free number, from 0 in the order in which nodes are first
/// visited. Its memory depends on the number of nodes, not on the size of the lattice.
/// Thread-safety: one thread.
class HashedNumbering {
  public:
    HashedNumbering();
    HashedNumbering(HashedNumbering&& other) noexcept;
    HashedNumbering& operator=(HashedNumbering&& other) noexcept;
    HashedNumbering(const HashedNumbering&) = delete;
    HashedNumbering& operator=(const HashedNumbering&) = delete;
    ~HashedNumbering();

    /// The number of a corner of the coarsest elements.
    std::uint64_t corner(const Int3& p);
    /// The number of the node halfway between those numbered a and b.
    std::uint64_t middle(std::uint64_t a, std::uint64_t b, const Int3& p);
    /// Number of visited nodes.
    [[nodiscard]] std::uint64_t count() const;
    /// Size of the table in bytes.
    [[nodiscard]] std::uint64_t heap() const;

  private:
    struct Table;
    std::unique_ptr<Table> table_;
};

/// What elements that differ only by a translation have in common. World units.
template <int D>
struct ElementShape {
    int level = 0;       ///< a level halves the edges; 0 is the finest
    int kind = 0;        ///< bisections since the last whole cube (square, edge); less than D
    double measure = 0;  ///< length, area or volume
    /// Gradients of the linear functions that are 1 at one vertex and 0 at the others, by vertex;
    /// 0 along flat axes.
    std::array<Double3, static_cast<std::size_t>(D) + 1> gradient{};
};

/// An element: an edge, a triangle or a tetrahedron. The refinement edge is that from vertex 0 to
/// vertex D - kind.
template <int D>
struct GridElement {
    std::array<Int3, static_cast<std::size_t>(D) + 1> vertex;         ///< nodes of the lattice
    std::array<std::uint64_t, static_cast<std::size_t>(D) + 1> node;  ///< their numbers
    const ElementShape<D>* shape;  ///< valid as long as the grid; equal for equal shapes
};

/// An adaptive grid of linear elements without hanging nodes on a lattice of nodes. It consists of
/// its active nodes: the corners of the coarsest elements, and the refinement nodes of all elements
/// that are refined. Elements that extend beyond the lattice are refined, those outside are
/// omitted, so the domain is exactly the box of the lattice.
///
/// D: the number of axes with more than one node. Copies share their data. Functions on a grid are
/// given by their values at the active nodes, in the order of nodes().number(). Memory: NodeSet, 16
/// bytes for each block of 16^3 cells (64^2 in a plane), and some tens of kilobytes. All results
/// are the same for any number of threads. Thread-safety: const methods one at a time, except those
/// of nodes().
template <int D>
class ImplicitGrid {
  public:
    /// All nodes of a lattice. `spacing`: world units between neighbours. `threads`: 0 = all, also
    /// for the products on this grid. Throws, also below, Error{invalid_argument} if not exactly D
    /// axes have more than one node, for an axis without nodes or with more than 2^20, or a spacing
    /// that is not positive and finite; Error{limit}.
    explicit ImplicitGrid(const Int3& nodes, const Double3& spacing = {1, 1, 1}, int threads = 0);
    /// Refined where `wanted(p, level)` is true for a refinement node p of the level, or for a node
    /// below. Called from many threads. Throws what it throws, and Error{cancelled}.
    static ImplicitGrid of_nodes(const Int3& nodes, const Double3& spacing,
                                 const std::function<bool(const Int3& p, int level)>& wanted,
                                 int threads = 0, Progress& progress = silent_progress());
    /// Refined where eta_{1,infinity} (Field::grad_linf_bar) of a function is not below a
    /// threshold. `values`: at all nodes of the lattice, x fastest. Throws Error{invalid_argument}
    /// for another number of values, one that is not finite, or a threshold below 0 or not finite.
    static ImplicitGrid of_values(const Int3& nodes, const Double3& spacing,
                                  std::span<const double> values, double threshold, int threads = 0,
                                  Progress& progress = silent_progress());
    static ImplicitGrid of_values(const Int3& nodes, const Double3& spacing,
                                  std::span<const float> values, double threshold, int threads = 0,
                                  Progress& progress = silent_progress());
    /// Refined where a field of a store is not below a threshold. Lengths are along the store's
    /// axes. Throws Error{unsupported} for a sheared volume, Error{not_found} for a field that the
    /// store does not have, and what reading it throws.
    static ImplicitGrid of_store(const Store& store, Field field, double threshold, int threads = 0,
                                 Progress& progress = silent_progress());

    /// The active nodes and their numbers.
    [[nodiscard]] const NodeSet& nodes() const;
    /// Number of active nodes.
    [[nodiscard]] std::size_t count() const { return static_cast<std::size_t>(nodes().count()); }
    [[nodiscard]] const Double3& spacing() const;
    /// Levels of the lattice: 1 + the level of the coarsest elements.
    [[nodiscard]] int levels() const;
    [[nodiscard]] int threads() const;
    /// Position of a node relative to node (0, 0, 0), along the lattice's axes, world units.
    [[nodiscard]] Double3 position(const Int3& p) const {
        const Double3& s = spacing();
        return {static_cast<double>(p.x) * s[0], static_cast<double>(p.y) * s[1],
                static_cast<double>(p.z) * s[2]};
    }
    /// Whether a node is at the boundary of the domain.
    [[nodiscard]] bool on_boundary(const Int3& p) const {
        const Int3 last = nodes().nodes() - Int3{1, 1, 1};
        for (int axis = 0; axis < 3; ++axis) {
            if (last[axis] > 0 && (p[axis] == 0 || p[axis] == last[axis])) {
                return true;
            }
        }
        return false;
    }
    /// Calls f(p, number) for each active node, in ascending order of the numbers.
    template <class F>
    void for_each_node(const F& f) const {
        nodes().for_each(f);
    }

    /// Calls action(const GridElement<D>&) for each element, with nodes numbered by nodes().
    /// Elements that run at the same time share no node, and those of a node come in the same order
    /// for any number of threads: so the action may add to numbers of its element's nodes.
    template <class Action>
    void for_each_element(const Action& action) const {
        visit([&](std::span<const GridElement<D>> some) {
            for (const GridElement<D>& t : some) {
                action(t);
            }
        });
    }
    /// The same in one thread, depth first as in the paper, with nodes numbered by the hash table.
    /// If the lattice does not have 2^k + 1 nodes along each axis, that also gets nodes beyond it,
    /// which no element has.
    template <class Action>
    void for_each_element(HashedNumbering& numbering, const Action& action) const {
        visit(numbering, [&](std::span<const GridElement<D>> some) {
            for (const GridElement<D>& t : some) {
                action(t);
            }
        });
    }
    /// Extends a function from the active nodes to all nodes of the lattice, x fastest: at other
    /// nodes it is the mean of its values at the ends of their refinement edge.
    void interpolate(std::span<const double> active, std::span<double> all) const;
    void interpolate(std::span<const float> active, std::span<float> all) const;

    /// For internal use by the library.
    [[nodiscard]] const detail::GridParts<D>& parts() const { return *parts_; }

  private:
    using Batch = std::function<void(std::span<const GridElement<D>>)>;
    ImplicitGrid() = default;
    void visit(const Batch& batch) const;
    void visit(HashedNumbering& numbering, const Batch& batch) const;

    std::shared_ptr<const detail::GridParts<D>> parts_;
};

extern template class ImplicitGrid<1>;
extern template class ImplicitGrid<2>;
extern template class ImplicitGrid<3>;

}  // namespace isonest
