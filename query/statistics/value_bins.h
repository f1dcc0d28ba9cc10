// Which bin of a histogram a value lies in.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>
#include <vector>

#include <isonest/value_type.h>

namespace isonest::detail {

/// The most bins that a histogram has.
inline constexpr int kMostBins = 256;

/// Bins between the smallest and the largest value: of integers as many whole numbers to each as
/// keep them within kMostBins (one, where the values are less than 256 apart; the last bin may have
/// fewer), of other types kMostBins of equal width, one if all values are the same.
struct ValueBins {
    /// The smallest value of each bin, ascending; equal ones where doubles do not tell them apart,
    /// and all but the last of these bins then stay empty. Empty if there is no value.
    std::vector<double> low;
    double end = 0;        ///< of the last bin: of integers the one behind it, else the last value
    bool integer = false;  ///< whole numbers

    ValueBins() = default;
    /// Of values of this type from `lowest` to `highest`; none if lowest > highest.
    ValueBins(ValueType type, double lowest, double highest);
    [[nodiscard]] int count() const { return static_cast<int>(low.size()); }
};

/// Thread-safety: const methods from any thread.
class BinFinder {
  public:
    /// REQUIRES: `bins` outlives this and has a bin.
    explicit BinFinder(const ValueBins& bins);

    /// The last bin k with value >= bins.low[k]; the first for values below all. REQUIRES: no NaN.
    [[nodiscard]] int operator()(double value) const {
        const double halves = bins_->integer ? value - first_ + kHalf : value / 2 - first_ / 2;
        // Not more than last_ also where the product is no number.
        const double guess = halves * per_half_;
        int k = guess < last_ ? static_cast<int>(std::max(guess, 0.0)) : static_cast<int>(last_);
        if (!bins_->integer) {
            const std::vector<double>& low = bins_->low;
            while (k + 1 < static_cast<int>(low.size()) && value >= low[k + 1]) {
                ++k;
            }
            while (k > 0 && value < low[k]) {
                --k;
            }
        }
        return k;
    }

  private:
    static constexpr double kHalf = 0.5;  // keeps whole numbers away from where rounding matters
    const ValueBins* bins_;
    double first_;
    double last_;
    double per_half_;
};

}  // namespace isonest::detail
