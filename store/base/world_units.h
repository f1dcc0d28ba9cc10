// Lengths in the unit of a volume's world.
#pragma once

#include <optional>
#include <string>

#include <isonest/length_unit.h>

namespace isonest::detail {

/// How many world units are as long as `length` of `given`. `unit`: that one of them is. Throws
/// Error{invalid_argument} where that is not known; `name`: of the volume or store.
double world_units(double length, LengthUnit given, std::optional<LengthUnit> unit,
                   const std::string& name);

}  // namespace isonest::detail
