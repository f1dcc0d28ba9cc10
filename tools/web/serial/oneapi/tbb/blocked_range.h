// Single-threaded replacement for oneTBB's header of this name.
#pragma once

#include <cstddef>

namespace tbb {

template <class Value>
class blocked_range {
  public:
    blocked_range(Value begin, Value end, std::size_t /*grain*/ = 1) : begin_(begin), end_(end) {}
    [[nodiscard]] Value begin() const { return begin_; }
    [[nodiscard]] Value end() const { return end_; }
    [[nodiscard]] std::size_t size() const { return static_cast<std::size_t>(end_ - begin_); }

  private:
    Value begin_;
    Value end_;
};

}  // namespace tbb
