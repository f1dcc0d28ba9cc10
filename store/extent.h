// Where a volume ends in the world.
#pragma once

#include "store/format.h"

namespace isonest {

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
