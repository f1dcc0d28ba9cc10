// Which nodes of a volume a caller takes, so that chunks without any need not be read.
#pragma once

#include <array>
#include <cstdint>

#include <isonest/int3.h>
#include <isonest/open_volume.h>

namespace isonest::detail {

/// Of a volume whose axes may still run backward, what SourceOptions::crop and `every` leave.
class NeededNodes {
  public:
    /// `nodes`: of the volume. All where the crop cannot be: cropped() will say so.
    NeededNodes(const Int3& nodes, const SourceOptions& options,
                const std::array<bool, 3>& backward)
        : nodes_(nodes), hi_(nodes), backward_(backward) {
        for (int a = 0; a < 3; ++a) {
            const NodeRange& range = options.crop.at(static_cast<std::size_t>(a));
            const std::int64_t n = nodes[a];
            const auto place = [n](std::int64_t at) { return at < 0 ? at + n : at; };
            const std::int64_t lo = place(range.from.value_or(0));
            const std::int64_t hi = place(range.to.value_or(n));
            if (lo >= 0 && lo < hi && hi <= n && options.every[a] >= 1) {
                lo_[a] = lo;
                hi_[a] = hi;
                every_[a] = options.every[a];
            }
        }
    }
    explicit NeededNodes(const Int3& nodes) : NeededNodes(nodes, {}, {}) {}

    /// Whether it takes any of [begin, end) of an axis as it is stored. REQUIRES: begin < end.
    [[nodiscard]] bool any(int axis, std::int64_t begin, std::int64_t end) const {
        const bool turned = backward_.at(static_cast<std::size_t>(axis));
        const std::int64_t from = turned ? nodes_[axis] - end : begin;
        const std::int64_t to = turned ? nodes_[axis] - begin : end;
        const std::int64_t behind =
            from <= lo_[axis] ? 0 : ceil_div(from - lo_[axis], every_[axis]);
        return lo_[axis] + behind * every_[axis] < std::min(to, hi_[axis]);
    }

  private:
    Int3 nodes_;
    Int3 lo_{0, 0, 0};
    Int3 hi_;
    Int3 every_{1, 1, 1};
    std::array<bool, 3> backward_;
};

}  // namespace isonest::detail
