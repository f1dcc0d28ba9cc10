// What rounding to float32 does to the coordinates of a mesh.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <isonest/int3.h>

namespace isonest::detail {

/// The largest absolute coordinate of nodes along an axis, world units.
inline double largest_coordinate(const Int3& nodes, const Double3& spacing, const Double3& origin,
                                 int axis) {
    const auto a = static_cast<std::size_t>(axis);
    const double last = origin[a] + spacing[a] * static_cast<double>(nodes[axis] - 1);
    return std::max(std::fabs(origin[a]), std::fabs(last));
}

/// Most by which it moves a coordinate, in distances of neighbouring nodes, of which each axis has
/// `nodes`. REQUIRES: world coordinates within float32.
inline double coordinate_rounding(const Int3& nodes, const Double3& spacing,
                                  const Double3& origin) {
    double most = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto largest = static_cast<float>(largest_coordinate(nodes, spacing, origin, axis));
        const double next = std::nextafter(largest, 0.0F);
        if (nodes[axis] > 1) {
            most = std::max(most, (static_cast<double>(largest) - next) / 2 / spacing[a]);
        }
    }
    return most;
}

/// The largest of what coordinates moved along each axis, world units, in distances of neighbouring
/// nodes.
inline double most_in_lattice(const Double3& moved, const Double3& spacing) {
    double most = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (moved[axis] > 0) {
            most = std::max(most, moved[axis] / std::fabs(spacing[axis]));
        }
    }
    return most;
}

}  // namespace isonest::detail
