// Where the samples of VTK's images lie, in VTI and in VTKHDF.
#pragma once

#include <array>
#include <cstddef>

#include <isonest/int3.h>

namespace isonest::detail {

struct VtkGrid {
    std::array<double, 9> direction{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< rows; axes are its columns
    Double3 spacing{1, 1, 1};

    /// The world's step along an axis.
    [[nodiscard]] Double3 step(std::size_t axis) const {
        return {direction[axis] * spacing[axis], direction[3 + axis] * spacing[axis],
                direction[6 + axis] * spacing[axis]};
    }
};

/// Moves `place` along an axis from index 0 to the first sample: a point, or between two points the
/// middle of a cell.
inline void to_first_sample(Double3& place, const Double3& step, double low, bool between) {
    for (std::size_t w = 0; w < 3; ++w) {
        place.at(w) += step.at(w) * (low + (between ? 0.5 : 0));
    }
}

}  // namespace isonest::detail
