// Differences of doubles, rounded away from zero: what a bound on them may be.
//
// Source of the exact remainder of a sum: D. E. Knuth, "The Art of Computer Programming", volume 2,
// 4.2.2, theorem B.
#pragma once

#include <cmath>
#include <limits>

namespace isonest::detail {

/// What a + b lost when it was rounded to `sum`: exact, but for overflow.
[[gnu::always_inline]] inline double lost_by_sum(double a, double b, double sum) {
    const double of_b = sum - a;
    return (a - (sum - of_b)) + (b - of_b);
}

/// At least |d + rest|, and |d| where the rest adds nothing. `unsure`: by how much the rest may be
/// off. NaN in the rest adds nothing.
[[gnu::always_inline]] inline double outward(double d, double rest, double unsure) {
    constexpr double kUp = 1 + 0x1p-51;
    const double size = std::fabs(d);
    const double rest_size = std::fabs(rest);
    const double along = (d < 0 ? -rest : rest) + unsure;
    const bool more = along > 0 || rest_size > size;
    return more ? (size + (rest_size + unsure)) * kUp : size;
}

/// At least |mid - (a + b) / 2|.
[[gnu::always_inline]] inline double outward_offset(double mid, double a, double b) {
    const double sum = a + b;
    const double half = 0.5 * sum;
    const double d = mid - half;
    return outward(d, lost_by_sum(mid, -half, d) - 0.5 * lost_by_sum(a, b, sum), 0);
}

}  // namespace isonest::detail
