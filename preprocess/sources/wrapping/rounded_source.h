// A source whose values are rounded to multiples of a step.
#pragma once

#include <cstddef>
#include <memory>

#include <isonest/data_rounding.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// Rounds values in place: finite ones to the nearest multiple of rounding.step, integers beyond
/// the ends of their type to these. Values that are not finite stay. A floating-point value that is
/// so large that all numbers of its type around it are such multiples stays, too.
/// REQUIRES: a rounding of isonest::rounding_of() for this type.
void round_values(ValueType type, const DataRounding& rounding, std::size_t count,
                  std::byte* values);

/// `inner`, not owned, with rounded values; null if nothing is rounded.
std::unique_ptr<VolumeSource> rounded_source(VolumeSource& inner, const DataRounding& rounding);

}  // namespace isonest::detail
