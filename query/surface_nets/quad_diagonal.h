// Along which diagonal a quad of a surface net is cut into triangles.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include <isonest/int3.h>

#include "store/base/vector3.h"

namespace isonest::detail {

/// How much the two triangles that a diagonal makes face in the same direction: the cosine of the
/// angle between their normals; -2 if one has no area.
inline double agreement(const std::array<float, 3>& from, const std::array<float, 3>& one,
                        const std::array<float, 3>& to, const std::array<float, 3>& other) {
    const auto side = [&](const std::array<float, 3>& p) {
        Double3 d{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            d[axis] = static_cast<double>(p[axis]) - static_cast<double>(from[axis]);
        }
        return d;
    };
    const Double3 diagonal = side(to);
    const Double3 a = cross(side(one), diagonal);
    const Double3 b = cross(diagonal, side(other));
    const double lengths = std::sqrt(dot(a, a) * dot(b, b));
    return lengths > 0 ? dot(a, b) / lengths : -2;
}

/// 0: the diagonal between the corners 0 and 2; 1: that between 1 and 3. The one whose triangles
/// face more in the same direction; of equals the first. Four corners in four quadrants around an
/// edge do not all lie on a line, so one of the two gives both triangles an area.
inline std::uint32_t flatter_diagonal(const std::array<std::array<float, 3>, 4>& corner) {
    return agreement(corner[1], corner[2], corner[3], corner[0]) >
                   agreement(corner[0], corner[1], corner[2], corner[3])
               ? 1
               : 0;
}

}  // namespace isonest::detail
