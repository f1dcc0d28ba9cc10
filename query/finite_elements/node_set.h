// The active nodes of an implicit grid: one bit for each node of the lattice, and their numbers.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7: no element is stored; the nodes that are
// refined say which elements AdaptTraverse finds, and which unknown belongs to a vertex.
#pragma once

#include <bit>
#include <cassert>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>

namespace isonest::detail {

/// A set of nodes of a lattice. Once it is finished, each has a number: its position among them,
/// x fastest. Takes 12 bytes for 64 nodes of the lattice, and 8 bytes for each row.
/// Thread-safety: const methods from any thread; insert() and row_words() of
/// different rows as well.
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
    /// REQUIRES of all that take a node: 0 <= p < nodes().
    [[nodiscard]] bool contains(const Int3& p) const { return (word(p) >> bit(p.x) & 1U) != 0; }
    void insert(const Int3& p) { words_[index(p)] |= std::uint64_t{1} << bit(p.x); }

    /// The bits of a row along x, 64 a word.
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
    /// How many there are. REQUIRES, as all below: finished.
    [[nodiscard]] std::uint64_t count() const { return first_.back(); }
    [[nodiscard]] bool is_full() const {
        return count() == static_cast<std::uint64_t>(nodes_.product());
    }
    /// The number of a node that it contains.
    [[nodiscard]] std::uint64_t number(const Int3& p) const {
        assert(contains(p));
        return number_from(p);
    }
    /// How many come before p.
    [[nodiscard]] std::uint64_t number_from(const Int3& p) const {
        const std::uint64_t lower = (std::uint64_t{1} << bit(p.x)) - 1;
        const std::size_t i = index(p);
        return first_[row(p)] + before_[i] +
               static_cast<std::uint64_t>(std::popcount(words_[i] & lower));
    }
    /// Calls f(x, number) for those of `count` nodes from p on along x, in ascending order.
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
    /// Whether it contains all `count` nodes from p on along x. REQUIRES: count <= 64.
    [[nodiscard]] bool contains_row(const Int3& p, std::int64_t count) const {
        const std::int64_t left = std::min<std::int64_t>(kBits - bit(p.x), count);
        const std::uint64_t bits = words_[index(p)] >> bit(p.x);
        return static_cast<std::int64_t>(std::countr_one(bits)) >= left &&
               (left == count || contains_row({p.x + left, p.y, p.z}, count - left));
    }
    /// Bytes that it holds.
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

}  // namespace isonest::detail
