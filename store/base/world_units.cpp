#include "store/base/world_units.h"

#include <fmt/format.h>

#include <isonest/error.h>

namespace isonest::detail {

double world_units(double length, LengthUnit given, std::optional<LengthUnit> unit,
                   const std::string& name) {
    if (!unit) {
        throw Error(
            ErrorKind::invalid_argument, {name},
            fmt::format("nothing says how many world units {:g} {} are: the volume's unit "
                        "of length is not known",
                        length, symbol_of(given)),
            {{RemedyKind::world_units}, {RemedyKind::say_unit, std::string(symbol_of(given))}});
    }
    return converted_length(length, given, *unit);
}

}  // namespace isonest::detail
