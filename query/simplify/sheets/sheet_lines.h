// The vertices of a patch in which several sheets meet.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace isonest::detail {

/// Of patches in which no sheets meet, every vertex is alone. Thread-safety: constant data.
class SheetLines {
  public:
    /// `next_copy`: of each vertex the next one that stands for the same, in rings; empty: each is
    /// alone. `locked`: vertices that stay; those are added of which a copy stays.
    SheetLines(std::span<const std::uint32_t> next_copy, std::vector<bool>& locked);

    [[nodiscard]] bool is_line(std::uint32_t v) const { return !next_.empty() && next_[v] != v; }
    [[nodiscard]] std::uint32_t next(std::uint32_t v) const { return next_[v]; }
    /// The smallest of the copies.
    [[nodiscard]] std::uint32_t first(std::uint32_t v) const {
        return first_.empty() ? v : first_[v];
    }
    /// Those that stay, and those of lines: other sheets know their edges.
    [[nodiscard]] const std::vector<bool>& known() const { return known_; }
    /// Those that stay, and all copies but the first.
    [[nodiscard]] const std::vector<bool>& silent() const { return silent_; }

  private:
    std::span<const std::uint32_t> next_;
    std::vector<std::uint32_t> first_;
    std::vector<bool> known_;
    std::vector<bool> silent_;
};

}  // namespace isonest::detail
