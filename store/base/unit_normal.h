// Normals as meshes hold them: 32-bit floats, of length 1.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include <isonest/int3.h>

#include "store/base/hypot3.h"

namespace isonest::detail {

/// The vector with length 1; 0 if it is 0 or not finite, so that it says nothing of a direction.
inline std::array<float, 3> unit_normal(Double3 n) {
    // Lengths near the ends of the range of doubles lose bits, or are infinite.
    constexpr double kSmall = 0x1p-900;
    constexpr double kLarge = 0x1p+1000;
    const double largest = std::max({std::fabs(n[0]), std::fabs(n[1]), std::fabs(n[2])});
    if (largest > 0 && (largest < kSmall || largest > kLarge)) {
        for (double& component : n) {
            component *= largest < kSmall ? 0x1p+200 : 0x1p-200;
        }
    }
    std::array<float, 3> unit{};
    const double size = hypot3(n[0], n[1], n[2]);
    if (size > 0 && std::isfinite(size)) {
        for (std::size_t i = 0; i < 3; ++i) {
            unit[i] = static_cast<float>(n[i] / size);
        }
    }
    return unit;
}

/// Whether unit_normal() found no direction.
inline bool has_no_direction(const std::array<float, 3>& normal) {
    return normal[0] == 0 && normal[1] == 0 && normal[2] == 0;
}

}  // namespace isonest::detail
