// Units of length: in which one the spacing and origin of a volume are, where that is known.
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

/// One unit is numerator / denominator metres, exactly.
struct LengthUnitInfo {
    LengthUnit unit;
    std::string_view symbol;  ///< "mm": ASCII, as stores and reports have it
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

/// The unit that is spelled so: its symbol ("mm", "um", "in"), its name in British or American
/// spelling, singular or plural, in any case ("Millimeters"), or another usual spelling ("micron",
/// the letters of mu and of Angstrom in UTF-8). Blanks around it do not count. Nothing for other
/// words; symbols are taken in their own case alone, but MM is mm.
std::optional<LengthUnit> length_unit_from(std::string_view spelling);

/// "km, m, ..., in": for messages.
std::string list_of_length_units();

/// How many `to` are as long as `length` `from`: rounded at most twice, and once where one of the
/// two is a multiple of the other.
double converted_length(double length, LengthUnit from, LengthUnit to);

}  // namespace isonest
