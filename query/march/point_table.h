// What lies in the nodes and edges of a lattice: a table within a brick, hashing everywhere else.
#pragma once

#include <tsl/robin_map.h>

#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "query/march/vertex_key.h"

namespace isonest::detail {

/// A number for each node and midpoint of an edge of a lattice: its points are twice the nodes, and
/// the sums of edges' ends. Not thread-safe.
class PointTable {
  public:
    static constexpr std::uint32_t kNone = 0xFFFFFFFFU;
    /// Bytes of the table for a box of `cells`^3.
    static constexpr std::uint64_t bytes(std::uint64_t cells) {
        return (cells + 1) * (cells + 1) * (cells + 1) * kPoints * sizeof(std::uint32_t);
    }

    /// From now on only points in the box of `cells` from node `low` on are asked for, which then
    /// takes no hashing. REQUIRES: empty.
    void place(const Int3& low, const Int3& cells) {
        low_ = low * 2;
        nodes_ = cells + Int3{1, 1, 1};
        const auto size = static_cast<std::size_t>(nodes_.product()) * kPoints;
        if (table_.size() < size) {
            table_.resize(size, kNone);
        }
    }

    /// The number at a point; where it is kNone, the caller has to put one. Valid until the next
    /// call.
    [[nodiscard]] std::uint32_t& at(const Int3& p) {
        if (table_.empty()) {
            return hashed(p);
        }
        const Int3 q = p - low_;
        const std::size_t index =
            static_cast<std::size_t>(nodes_.linear({q.x >> 1, q.y >> 1, q.z >> 1})) * kPoints +
            static_cast<std::size_t>((q.x & 1) + 2 * (q.y & 1) + 4 * (q.z & 1));
        if (table_[index] == kNone) {
            fill(static_cast<std::uint32_t>(index));
        }
        return table_[index];
    }

    /// Back to kNone everywhere.
    void clear() {
        for (const std::uint32_t index : filled_) {
            table_[index] = kNone;
        }
        filled_.clear();
        elsewhere_.clear();
    }

  private:
    /// A node and the midpoints of the seven kinds of edges from it.
    static constexpr std::size_t kPoints = 8;

    // Seldom called, and kept out of at(), which is called for every corner of every triangle.
    [[gnu::noinline]] std::uint32_t& hashed(const Int3& p) {
        return elsewhere_.try_emplace(half_lattice_key(p), kNone).first.value();
    }
    [[gnu::noinline]] void fill(std::uint32_t index) { filled_.push_back(index); }

    Int3 low_;  ///< twice the box's first node
    Int3 nodes_;
    std::vector<std::uint32_t> table_;
    std::vector<std::uint32_t> filled_;
    tsl::robin_map<std::uint64_t, std::uint32_t, HalfLatticeHash> elsewhere_;
};

}  // namespace isonest::detail
