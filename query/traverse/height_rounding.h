// How much the heights of a graph are rounded.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "query/march/corner.h"

namespace isonest::detail {

/// Most by which the heights scale * value are rounded as float32; where the box cuts, of what lies
/// between them as well.
inline double height_rounding(const std::array<Corner, 3>& corners, double scale, bool cut) {
    double most = 0;
    for (const Corner& corner : corners) {
        const double height = scale * corner.value;
        const auto stored = static_cast<float>(height);
        most = std::max(most, std::fabs(static_cast<double>(stored) - height) +
                                  std::fabs(std::fma(scale, corner.value, -height)));
        if (cut) {
            const float size = std::fabs(stored);
            const float next = std::nextafter(size, std::numeric_limits<float>::infinity());
            most = std::max(most, static_cast<double>(next) - static_cast<double>(size));
        }
    }
    return most;
}

}  // namespace isonest::detail
