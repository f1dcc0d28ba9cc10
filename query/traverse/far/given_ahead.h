// How many subtrees look_ahead() is given at a time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>

namespace isonest::detail {

/// Those that it does not take, because their chunks are too many, were walked in vain: so after
/// that it is given at most twice as many as it took, and each time that it takes all of so many,
/// twice as many again. Not thread-safe.
class GivenAhead {
  public:
    /// Of `left` subtrees, the first so many.
    [[nodiscard]] std::size_t of(std::size_t left) const { return std::min(most_, left); }
    void took(std::size_t taken, std::size_t given) {
        constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();
        if (taken < given) {
            most_ = 2 * taken;
        } else if (given == most_) {
            most_ = most_ > kAll / 2 ? kAll : 2 * most_;
        }
    }

  private:
    std::size_t most_ = std::numeric_limits<std::size_t>::max();
};

}  // namespace isonest::detail
