// Where a volume lies in the world.
#pragma once

#include <cmath>

#include "store/format.h"

namespace isonest {

/// Whether a volume can lie so: a positive spacing, everything finite.
inline bool is_place(const Double3& spacing, const Double3& origin) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (!(spacing[axis] > 0) || !std::isfinite(spacing[axis]) || !std::isfinite(origin[axis])) {
            return false;
        }
    }
    return true;
}

/// World position of the last node; the first lies at the header's origin.
inline Double3 last_position(const StoreHeader& header) {
    Double3 last{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::int64_t cells = header.nodes[static_cast<int>(axis)] - 1;
        last[axis] = header.origin[axis] + header.spacing[axis] * static_cast<double>(cells);
    }
    return last;
}

}  // namespace isonest
