// A source whose slices are scaled each in its own way.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include <isonest/int3.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// value = slope * stored + intercept, of the stored number or the nearest one from `least` to
/// `most`.
struct SliceScaling {
    struct Line {
        double slope = 1;
        double intercept = 0;
        bool operator==(const Line&) const = default;
    };
    double least = -HUGE_VAL;
    double most = HUGE_VAL;
    std::vector<Line> lines{Line{}};
    Int3 strides{0, 0, 0};  ///< of `lines`, from a node to the next along x, y and z
};

/// `inner` scaled: integers of up to 16 bits and float32 to float32, others to float64. Where all
/// lines keep what is stored, the type stays; the source itself where no number changes either.
std::unique_ptr<VolumeSource> scaled_by_slices(std::unique_ptr<VolumeSource> inner,
                                               SliceScaling scaling);

}  // namespace isonest::detail
