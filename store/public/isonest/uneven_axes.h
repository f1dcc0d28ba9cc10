// Axes along which the distances between neighbouring nodes differ (rectilinear grids).
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

namespace isonest {

/// Where the nodes of a rectilinear grid lie along its axes.
struct UnevenAxes {
    /// For x, y and z: the distance of each node from node 0 along the axis, in world units; it
    /// starts with 0 and increases. Empty: the axis is even, its nodes are `spacing` apart.
    std::array<std::vector<double>, 3> offsets;

    bool operator==(const UnevenAxes&) const = default;
};

/// Null: all axes are even.
using UnevenAxesPtr = std::shared_ptr<const UnevenAxes>;

/// Maximum number of nodes along an uneven axis.
inline constexpr std::size_t kMaxUnevenNodes = 8000;

}  // namespace isonest
