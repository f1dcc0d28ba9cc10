// How far the points of a surface may have been moved to become those of a triangle.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <isonest/int3.h>

namespace isonest::detail {

/// A box that contains m - s for each pair of a point s of the full surface and a point m of the
/// triangle that are related, up to a vector of length `radius`. World units.
struct Displacement {
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    float radius = 0;  ///< of what was measured as a distance

    /// No related points are further from each other.
    [[nodiscard]] double bound() const {
        double sum = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            const double far = std::max(-static_cast<double>(lo[a]), static_cast<double>(hi[a]));
            sum += far * far;
        }
        constexpr double kRounding = 1e-14;
        return (std::sqrt(sum) + static_cast<double>(radius)) * (1 + kRounding);
    }
    bool operator==(const Displacement&) const = default;
};

/// A float that is no smaller, or no larger.
inline float float_above(double x) {
    const auto f = static_cast<float>(x);
    return static_cast<double>(f) < x ? std::nextafterf(f, std::numeric_limits<float>::infinity())
                                      : f;
}
inline float float_below(double x) {
    return -float_above(-x);
}

/// That of a triangle whose points are then moved by a part of `by`, each by another.
inline Displacement moved_up_to(Displacement d, const Double3& by) {
    for (std::size_t a = 0; a < 3; ++a) {
        d.lo[a] = float_below(static_cast<double>(d.lo[a]) + std::min(by[a], 0.0));
        d.hi[a] = float_above(static_cast<double>(d.hi[a]) + std::max(by[a], 0.0));
    }
    return d;
}

}  // namespace isonest::detail
