// Numbers for all nodes that elements of the nested grid reach.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The nodes that elements reach, those beyond the volume too. Level L's cubes tile the volume, so
/// what they reach grows with L: there are few nodes beyond what level 1's reach, on coarse levels
/// alone.
class NodeIndex {
  public:
    explicit NodeIndex(const Lattice& lattice) {
        for (int level = std::min(1, lattice.top()); level <= lattice.top(); ++level) {
            const Int3 last = lattice.cells_at(level) * (std::int64_t{1} << level);
            if (regions_.empty() || last != regions_.back().last) {
                const std::int64_t scale = level > 0 ? std::int64_t{1} << (level - 1) : 1;
                const Int3 size =
                    Int3{last.x / scale, last.y / scale, last.z / scale} + Int3{1, 1, 1};
                regions_.push_back({last, size, scale, count_});
                count_ += static_cast<std::size_t>(size.product());
            }
        }
    }
    [[nodiscard]] std::size_t count() const { return count_; }
    /// REQUIRES: an element reaches the node.
    [[nodiscard]] std::size_t of(const Int3& p) const {
        const Region* region = regions_.data();
        while (max(p, region->last) != region->last) {
            ++region;
        }
        return region->first +
               static_cast<std::size_t>(region->size.linear(
                   {p.x / region->scale, p.y / region->scale, p.z / region->scale}));
    }
    /// The size of the dense lattice of all nodes that level 1's cubes reach.
    [[nodiscard]] const Int3& dense() const { return regions_.front().size; }
    /// Calls f(p) for all nodes beyond.
    template <class F>
    void for_others(const F& f) const {
        for (std::size_t r = 1; r < regions_.size(); ++r) {
            const Int3& nearer = regions_[r - 1].last;
            for (std::int64_t i = 0; i < regions_[r].size.product(); ++i) {
                const Int3 p = regions_[r].size.unlinear(i) * regions_[r].scale;
                if (max(p, nearer) != nearer) {
                    f(p);
                }
            }
        }
    }

  private:
    /// Multiples of `scale` up to `last`.
    struct Region {
        Int3 last;
        Int3 size;
        std::int64_t scale;
        std::size_t first;
    };
    std::vector<Region> regions_;
    std::size_t count_ = 0;
};

}  // namespace isonest::detail
