// Lengths in the unit of a volume's world.
#pragma once

#include <optional>
#include <string>

#include <isonest/length_unit.h>

namespace isonest::detail {

/// Converts `length` in units of `given` to world units. `unit`: the world unit. Throws
/// Error{invalid_argument} if it is unknown; `name`: of the volume or store, for the message.
double world_units(double length, LengthUnit given, std::optional<LengthUnit> unit,
                   const std::string& name);

}  // namespace isonest::detail
