// Where a volume lies in the world.
#pragma once

#include <string>

#include <isonest/volume_source.h>

#include "store/container/format.h"

namespace isonest::detail {

/// Node distances, and coordinates on either side of 0, that a volume may have. Below, the 32-bit
/// floats of meshes would become 0; above, squares of distances would not be finite. (Meshes of
/// volumes beyond the 32-bit floats are refused when they are asked for.)
inline constexpr double kLeastSpacing = 1e-30;
inline constexpr double kMostSpacing = 1e100;
inline constexpr double kMostCoordinate = 1e110;

/// Empty if a volume can lie so; otherwise what is wrong and what is possible. It cannot if
/// 32-bit floats make one coordinate of an axis' first and last node.
std::string why_no_place(const Int3& nodes, const Double3& spacing, const Double3& origin);

/// Position of the last node in the volume's own axes, which are turned about the first node at the
/// header's origin.
inline Double3 last_position(const StoreHeader& header) {
    Double3 last{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::int64_t cells = header.nodes[static_cast<int>(axis)] - 1;
        last[axis] = header.origin[axis] + header.spacing[axis] * static_cast<double>(cells);
    }
    return last;
}

/// What a store of the volume says of its nodes and their place.
inline StoreHeader header_of(const VolumeDescription& volume) {
    StoreHeader header;
    header.nodes = volume.nodes;
    header.type = volume.type;
    header.spacing = volume.spacing;
    header.origin = volume.origin;
    header.direction = volume.direction;
    header.labels = volume.labels;
    header.unit = volume.unit;
    header.frame = volume.frame;
    return header;
}

/// Length of the volume's diagonal in the world.
double diagonal_of(const StoreHeader& header);

}  // namespace isonest::detail
