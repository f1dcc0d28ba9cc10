// The refined nodes of a lattice: those whose indicator is not below a threshold, and all others
// needed for a grid without hanging nodes that ends where the volume ends.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 4, 5 and 7. A node is active if bar(x) =
// max(eta(x), max bar(c)) >= threshold, where c are the child nodes; so one bit per node is
// sufficient. If the volume does not end at a cube of a level, the elements that extend beyond it
// are also refined: elements outside are omitted, all others are in the volume.
#pragma once

#include <bit>
#include <cassert>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>

#include "store/container/chunk_cache.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// The refinement nodes of one slot and level of a lattice, row by row along x.

/// Multiples of `scale` that are odd along some axes and even along the others, within the volume.
struct SlotRows {
    std::int64_t scale;
    Int3 odd;    ///< 0 or 1 per axis
    Int3 count;  ///< per axis

    SlotRows(const Lattice& lattice, int level, int slot)
        : scale(std::int64_t{1} << (level - 1)), odd(slot_offset(slot)) {
        for (int axis = 0; axis < 3; ++axis) {
            const std::int64_t last = lattice.nodes()[axis] - 1 - odd[axis] * scale;
            count[axis] = last < 0 ? 0 : last / (2 * scale) + 1;
        }
    }
    [[nodiscard]] std::int64_t rows() const { return count.y * count.z; }
    [[nodiscard]] Int3 first_of(std::int64_t row) const { return node(0, row); }
    [[nodiscard]] Int3 node(std::int64_t i, std::int64_t row) const {
        return (Int3{i, row % count.y, row / count.y} * 2 + odd) * scale;
    }
    /// If p is the i-th node of a row, the ends of its refinement edge are p - half and p + half.
    [[nodiscard]] Int3 half_edge(std::int64_t i, const Int3& p) const {
        const auto along = [&](int axis, std::int64_t q) {
            return odd[axis] == 0 ? 0 : (q & 1) != 0 ? -scale : scale;
        };
        return {along(0, i), along(1, p.y / scale / 2), along(2, p.z / scale / 2)};
    }
};

// The active nodes of an implicit grid: one bit for each node of the lattice, and their numbers.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7: no element is stored; the refined nodes
// determine which elements AdaptTraverse finds, and which unknown belongs to a vertex.

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

/// eta_{1,infinity} of the hat function at a node: |grad| = factor * |U_delta|. `odd_axes`: bits of
/// the axes along which the node's refinement edge runs. REQUIRES: level > 0, an odd axis, none of
/// them flat.
double hat_gradient(const Lattice& lattice, const Double3& spacing, int level, unsigned odd_axes);

/// The refined nodes and the corners of the coarsest elements. `wanted`: whether the indicator,
/// saturated or not, is large enough at a refinement node of a level; called from many threads.
/// `threads`: 0 = all. Throws what `wanted` throws and Error{cancelled}.
NodeSet active_nodes(const Lattice& lattice,
                     const std::function<bool(const Int3& p, int level)>& wanted, int threads,
                     Progress& progress);

/// By eta_{1,infinity} (Field::grad_linf_bar) of the values of all nodes in memory, x fastest. A
/// threshold of 0 makes all nodes active. REQUIRES: they are finite; threshold >= 0.
template <class Real>
NodeSet active_nodes(const Lattice& lattice, const Double3& spacing, std::span<const Real> values,
                     double threshold, int threads, Progress& progress);

/// Active nodes by a field of a store.
NodeSet active_nodes(ChunkCache& cache, Field field, double threshold, int threads,
                     Progress& progress);

}  // namespace isonest::detail
