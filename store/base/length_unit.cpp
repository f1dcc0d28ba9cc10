#include "store/base/length_unit.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

#include <isonest/error.h>
#include <isonest/length_unit.h>

namespace isonest {
namespace {

constexpr std::int64_t kThousand = 1000;
constexpr std::int64_t kMillion = 1000 * kThousand;
constexpr std::int64_t kBillion = 1000 * kMillion;

// The international inch and foot.
constexpr std::array<LengthUnitInfo, 11> kUnits{
    {{LengthUnit::kilometre, "km", "kilometre", kThousand, 1},
     {LengthUnit::metre, "m", "metre", 1, 1},
     {LengthUnit::decimetre, "dm", "decimetre", 1, 10},
     {LengthUnit::centimetre, "cm", "centimetre", 1, 100},
     {LengthUnit::millimetre, "mm", "millimetre", 1, kThousand},
     {LengthUnit::micrometre, "um", "micrometre", 1, kMillion},
     {LengthUnit::nanometre, "nm", "nanometre", 1, kBillion},
     {LengthUnit::angstrom, "angstrom", "angstrom", 1, 10 * kBillion},
     {LengthUnit::picometre, "pm", "picometre", 1, kThousand* kBillion},
     {LengthUnit::foot, "ft", "foot", 381, 1250},
     {LengthUnit::inch, "in", "inch", 127, 5000}}};

/// Spellings that are neither a symbol nor a name; in lower case if ASCII. ImageJ writes mu as an
/// escape sequence.
constexpr std::array<std::pair<std::string_view, LengthUnit>, 18> kOthers{
    {{"MM", LengthUnit::millimetre},
     {"micron", LengthUnit::micrometre},
     {"mu", LengthUnit::micrometre},
     {"\xc2\xb5m", LengthUnit::micrometre},
     {"\xce\xbcm", LengthUnit::micrometre},
     {"\xc2\xb5", LengthUnit::micrometre},
     {"\xce\xbc", LengthUnit::micrometre},
     {"\xb5m", LengthUnit::micrometre},
     {"\\u00b5m", LengthUnit::micrometre},
     {"\\u03bcm", LengthUnit::micrometre},
     {"\xc3\x85", LengthUnit::angstrom},
     {"\xe2\x84\xab", LengthUnit::angstrom},
     {"\xc3\x85ngstr\xc3\xb6m", LengthUnit::angstrom},
     {"\xc3\xa5ngstr\xc3\xb6m", LengthUnit::angstrom},
     {"\\u00c5", LengthUnit::angstrom},
     {"ang", LengthUnit::angstrom},
     {"inches", LengthUnit::inch},
     {"feet", LengthUnit::foot}}};

const LengthUnitInfo& info_of(LengthUnit unit) {
    return kUnits.at(static_cast<std::size_t>(unit));
}

std::string_view trimmed(std::string_view text) {
    constexpr std::string_view kBlank(" \t\r\n\0", 5);
    const std::size_t from = std::min(text.find_first_not_of(kBlank), text.size());
    text.remove_prefix(from);
    return text.substr(0, text.find_last_not_of(kBlank) + 1);
}

std::string lower_case(std::string_view text) {
    std::string out(text);
    for (char& c : out) {
        c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    }
    return out;
}

/// Converts to singular and British spelling.
std::string as_named(std::string word) {
    if (word.ends_with('s') && word.size() > 4) {
        word.pop_back();
    }
    if (word.ends_with("meter")) {
        word.replace(word.size() - 2, 2, "re");
    }
    return word;
}

}  // namespace

std::span<const LengthUnitInfo> length_units() {
    return kUnits;
}

std::string_view symbol_of(LengthUnit unit) {
    return info_of(unit).symbol;
}

std::string_view name_of(LengthUnit unit) {
    return info_of(unit).name;
}

std::optional<LengthUnit> length_unit_from(std::string_view spelling) {
    const std::string_view word = trimmed(spelling);
    const std::string lower = lower_case(word);
    const std::string name = as_named(lower);
    for (const LengthUnitInfo& info : kUnits) {
        if (word == info.symbol || name == info.name) {
            return info.unit;
        }
    }
    for (const auto& [other, unit] : kOthers) {
        if (word == other || lower == other || name == other) {
            return unit;
        }
    }
    return std::nullopt;
}

std::string list_of_length_units() {
    std::string list;
    for (const LengthUnitInfo& info : kUnits) {
        list += (list.empty() ? "" : ", ") + std::string(info.symbol);
    }
    return list;
}

double converted_length(double length, LengthUnit from, LengthUnit to) {
    const LengthUnitInfo& a = info_of(from);
    const LengthUnitInfo& b = info_of(to);
    const std::int64_t numerators = std::gcd(a.numerator, b.numerator);
    const std::int64_t denominators = std::gcd(a.denominator, b.denominator);
    const std::int64_t up = (a.numerator / numerators) * (b.denominator / denominators);
    const std::int64_t down = (b.numerator / numerators) * (a.denominator / denominators);
    return length * static_cast<double>(up) / static_cast<double>(down);
}

}  // namespace isonest

namespace isonest::detail {

double world_units(double length, LengthUnit given, std::optional<LengthUnit> unit,
                   const std::string& name) {
    if (!unit) {
        throw Error(
            ErrorKind::invalid_argument, {name},
            fmt::format("the volume has no unit, so {:g} {} cannot be converted", length,
                        symbol_of(given)),
            {{RemedyKind::world_units}, {RemedyKind::say_unit, std::string(symbol_of(given))}});
    }
    return converted_length(length, given, *unit);
}

}  // namespace isonest::detail
