// Between a volume's own axes and those of the world.
#pragma once

#include <algorithm>
#include <cmath>

#include <isonest/int3.h>

#include "store/base/vector3.h"

namespace isonest::detail {

/// The vector that has these components along the directions.
inline Double3 rotated(const Directions& direction, const Double3& v) {
    Double3 out{};
    for (std::size_t w = 0; w < 3; ++w) {
        out[w] = direction[0][w] * v[0] + direction[1][w] * v[1] + direction[2][w] * v[2];
    }
    return out;
}

/// Its inverse: a vector's components along the directions.
inline Double3 unrotated(const Directions& direction, const Double3& v) {
    return {dot(direction[0], v), dot(direction[1], v), dot(direction[2], v)};
}

/// The same about a point that stays where it is.
inline Double3 rotated_about(const Double3& point, const Directions& direction, const Double3& p) {
    const Double3 v = rotated(direction, {p[0] - point[0], p[1] - point[1], p[2] - point[2]});
    return {point[0] + v[0], point[1] + v[1], point[2] + v[2]};
}
inline Double3 unrotated_about(const Double3& point, const Directions& direction,
                               const Double3& p) {
    const Double3 v = unrotated(direction, {p[0] - point[0], p[1] - point[1], p[2] - point[2]});
    return {point[0] + v[0], point[1] + v[1], point[2] + v[2]};
}

/// Whether these are unit vectors at right angles, right-handed, but for rounding.
inline bool are_directions(const Directions& d) {
    constexpr double kRounding = 1e-9;
    double most = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t b = 0; b <= a; ++b) {
            most = std::max(most, std::fabs(dot(d[a], d[b]) - (a == b ? 1 : 0)));
        }
    }
    // A comparison with NaN is false.
    return most <= kRounding && dot(cross(d[0], d[1]), d[2]) > 0;
}

}  // namespace isonest::detail
