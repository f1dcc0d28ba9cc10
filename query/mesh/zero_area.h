// Triangles that have no area.
//
// Source of the exact sum: J. R. Shewchuk, "Adaptive precision floating-point arithmetic and fast
// robust geometric predicates", Discrete & Computational Geometry 18 (1997), section 2.4.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace isonest::detail {

/// Whether the sum is 0 exactly. REQUIRES: no overflow.
template <std::size_t N>
bool is_zero_sum(const std::array<double, N>& terms) {
    // Summands that do not overlap: their sum is that of the terms so far.
    std::array<double, N> parts{};
    std::size_t count = 0;
    for (double x : terms) {
        std::size_t kept = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const double sum = x + parts[i];
            const double virtual_part = sum - x;
            const double rest = (x - (sum - virtual_part)) + (parts[i] - virtual_part);
            if (rest != 0) {
                parts[kept++] = rest;
            }
            x = sum;
        }
        count = kept;
        if (x != 0) {
            parts[count++] = x;
        }
    }
    return count == 0;
}

/// Whether the corners lie on a line, or some are equal; exactly, so in whatever order they come.
inline bool has_no_area(const std::array<float, 3>& a, const std::array<float, 3>& b,
                        const std::array<float, 3>& c) {
    constexpr double kRounding = 1e-15;  // of a sum or difference of two products, at most
    const auto is_flat = [&](std::size_t i, std::size_t j) {
        const auto d = [&a](const std::array<float, 3>& q, std::size_t axis) {
            return static_cast<double>(q[axis]) - static_cast<double>(a[axis]);
        };
        const double left = d(b, i) * d(c, j);
        const double right = d(b, j) * d(c, i);
        if (std::fabs(left - right) > kRounding * (std::fabs(left) + std::fabs(right))) {
            return false;
        }
        // Products of floats are exact in double.
        const auto product = [](float x, float y) {
            return static_cast<double>(x) * static_cast<double>(y);
        };
        return is_zero_sum<6>({product(a[i], b[j]), -product(a[j], b[i]), product(b[i], c[j]),
                               -product(b[j], c[i]), product(c[i], a[j]), -product(c[j], a[i])});
    };
    return is_flat(1, 2) && is_flat(2, 0) && is_flat(0, 1);
}

}  // namespace isonest::detail
