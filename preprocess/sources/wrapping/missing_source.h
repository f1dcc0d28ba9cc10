// A source some of whose values stand for "missing".
#pragma once

#include <memory>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// `inner` with values equal to `missing` replaced by NaN: as float32 where that holds all values
/// of the inner type (float32 and integers of up to 16 bits), else as float64. Throws
/// Error{invalid_argument} if the inner type cannot hold `missing`.
std::unique_ptr<VolumeSource> with_missing(std::unique_ptr<VolumeSource> inner, double missing);

}  // namespace isonest::detail
