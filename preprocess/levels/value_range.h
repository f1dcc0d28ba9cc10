// The range of finite values, row by row.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "preprocess/indicators/value_rows.h"

namespace isonest::detail {

/// Smallest and largest finite value so far, in lanes that compilers keep in vector registers.
template <class T>
class ValueRange {
  public:
    ValueRange() {
        low_.fill(std::numeric_limits<T>::max());
        high_.fill(std::numeric_limits<T>::lowest());
    }
    void include(const T* row, std::int64_t n) {
        std::int64_t i = 0;
        if constexpr (std::is_floating_point_v<T>) {
            if (!all_finite(row, n)) {
                missing_ = true;
                for (; i < n; ++i) {
                    if (std::isfinite(row[i])) {
                        lane(0, row[i]);
                    }
                }
            }
        }
        // Copies, because a row of bytes may alias the members.
        std::array<T, kLanes> low = low_;
        std::array<T, kLanes> high = high_;
        for (; i + static_cast<std::int64_t>(kLanes) <= n; i += kLanes) {
            for (std::size_t l = 0; l < kLanes; ++l) {
                const T v = row[i + static_cast<std::int64_t>(l)];
                low[l] = v < low[l] ? v : low[l];
                high[l] = v > high[l] ? v : high[l];
            }
        }
        low_ = low;
        high_ = high;
        for (; i < n; ++i) {
            lane(0, row[i]);
        }
    }
    /// (+inf, -inf) if there was none.
    [[nodiscard]] double min() const {
        return any() ? static_cast<double>(*std::min_element(low_.begin(), low_.end()))
                     : std::numeric_limits<double>::infinity();
    }
    [[nodiscard]] double max() const {
        return any() ? static_cast<double>(*std::max_element(high_.begin(), high_.end()))
                     : -std::numeric_limits<double>::infinity();
    }
    [[nodiscard]] bool missing() const { return missing_; }

  private:
    static constexpr std::size_t kLanes = 16;
    void lane(std::size_t l, T v) {
        low_[l] = v < low_[l] ? v : low_[l];
        high_[l] = v > high_[l] ? v : high_[l];
    }
    [[nodiscard]] bool any() const {
        return *std::min_element(low_.begin(), low_.end()) <=
               *std::max_element(high_.begin(), high_.end());
    }

    std::array<T, kLanes> low_;
    std::array<T, kLanes> high_;
    bool missing_ = false;
};

}  // namespace isonest::detail
