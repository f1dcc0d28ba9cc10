// Units of length, for the spacing and origin of a volume if the unit is known.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace isonest {

enum class LengthUnit : std::uint8_t {
    kilometre,
    metre,
    decimetre,
    centimetre,
    millimetre,
    micrometre,
    nanometre,
    angstrom,
    picometre,
    foot,
    inch
};

/// One unit is exactly numerator / denominator metres.
struct LengthUnitInfo {
    LengthUnit unit;
    std::string_view symbol;  ///< "mm": ASCII, as in stores and reports
    std::string_view name;    ///< "millimetre"
    std::int64_t numerator;
    std::int64_t denominator;
};

/// All units, in the order of the enumeration.
std::span<const LengthUnitInfo> length_units();

/// "mm", "um", "angstrom".
std::string_view symbol_of(LengthUnit unit);
/// "millimetre".
std::string_view name_of(LengthUnit unit);

/// The unit with this spelling: its symbol ("mm", "um", "in"), its name in British or American
/// spelling, singular or plural, in upper or lower case ("Millimeters"), or another usual spelling
/// ("micron", the letters mu and Angstrom in UTF-8). Surrounding blanks are ignored. Nullopt for
/// other words. Symbols are case-sensitive, except that MM is mm.
std::optional<LengthUnit> length_unit_from(std::string_view spelling);

/// "km, m, ..., in": for messages.
std::string list_of_length_units();

/// Converts a length between units; rounded at most twice, and only once if one unit is a multiple
/// of the other.
double converted_length(double length, LengthUnit from, LengthUnit to);

}  // namespace isonest
