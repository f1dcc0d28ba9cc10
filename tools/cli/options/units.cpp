#include "tools/cli/options/units.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>

#include <isonest/error.h>

#include "store/base/label_text.h"
#include "store/base/length_unit.h"

namespace isonest::detail::cli {
namespace {

[[noreturn]] void fail(std::string_view option, std::string_view text, std::string_view wanted) {
    throw Error(ErrorKind::invalid_argument, fmt::format("{} '{}': give {}", option, text, wanted));
}

std::vector<std::string_view> split(std::string_view text, char separator) {
    std::vector<std::string_view> parts;
    for (;;) {
        const std::size_t at = text.find(separator);
        parts.push_back(text.substr(0, at));
        if (at == std::string_view::npos) {
            return parts;
        }
        text.remove_prefix(at + 1);
    }
}

/// Parses the number at the start of `text` and removes it from `text`.
bool leading_number(std::string_view& text, double& value) {
    const char* const end = text.data() + text.size();
    // from_chars() does not accept a plus sign.
    const bool plus = text.size() > 1 && text[0] == '+' && text[1] != '-';
    const char* const begin = text.data() + (plus ? 1 : 0);
    const auto [rest, error] = std::from_chars(begin, end, value);
    if (error != std::errc() || !std::isfinite(value)) {
        return false;
    }
    text.remove_prefix(static_cast<std::size_t>(rest - text.data()));
    return true;
}

std::string human(double value, double base, const char* first_unit, const char* unit) {
    constexpr std::array<const char*, 6> kPrefixes{"", "k", "M", "G", "T", "P"};
    std::size_t i = 0;
    while (i + 1 < kPrefixes.size() && std::abs(value) >= base) {
        value /= base;
        ++i;
    }
    if (i == 0) {
        return fmt::format("{:.0f}{}{}", value, first_unit[0] == '\0' ? "" : " ", first_unit);
    }
    const int digits = std::abs(value) < 10 ? 2 : std::abs(value) < 100 ? 1 : 0;
    return fmt::format("{:.{}f} {}{}", value, digits, kPrefixes[i], unit);
}

}  // namespace

std::uint64_t parse_bytes(std::string_view option, std::string_view text) {
    constexpr std::string_view kForm = "a size such as 512M or 2G, or a number of bytes";
    std::string_view rest = text;
    double value = 0;
    if (!leading_number(rest, value) || value < 0) {
        fail(option, text, kForm);
    }
    if (!rest.empty() && rest.front() == ' ') {
        rest.remove_prefix(1);
    }
    double unit = 1;
    if (!rest.empty()) {
        constexpr std::string_view kPrefixes = "kmgt";
        const auto lower = static_cast<char>(rest.front() | 0x20);
        const std::size_t power = kPrefixes.find(lower);
        if (power != std::string_view::npos) {
            unit = std::ldexp(1.0, 10 * (static_cast<int>(power) + 1));
            rest.remove_prefix(1);
            if (rest.starts_with("i")) {
                rest.remove_prefix(1);
                if (rest.empty()) {
                    fail(option, text, kForm);
                }
            }
        }
        if (!rest.empty() && rest != "B" && rest != "b") {
            fail(option, text, kForm);
        }
    }
    const double bytes = value * unit;
    if (bytes >= 0x1p63) {
        fail(option, text, "fewer than 2^63 bytes");
    }
    if (bytes != std::floor(bytes) && unit == 1) {
        fail(option, text, "a whole number of bytes");
    }
    return static_cast<std::uint64_t>(bytes);
}

double parse_number(std::string_view option, std::string_view text) {
    std::string_view rest = text;
    double value = 0;
    if (!leading_number(rest, value) || !rest.empty()) {
        fail(option, text, "a finite number");
    }
    return value;
}

Length parse_length(std::string_view option, std::string_view text) {
    Length length;
    std::string_view rest = text;
    if (!leading_number(rest, length.value)) {
        fail(option, text, "a finite number, alone or with its unit");
    }
    if (length.value < 0) {
        fail(option, text, "a number >= 0");
    }
    if (rest.empty()) {
        return length;
    }
    length.voxels = rest == "voxel" || rest == "voxels";
    length.unit = length_unit_from(rest);
    if (!length.unit && !length.voxels) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': unknown unit; give a plain number, in the store's unit, "
                                "or one with {} or voxel",
                                option, text, list_of_length_units()));
    }
    return length;
}

double in_world_units(const Length& length, std::optional<LengthUnit> unit,
                      const std::string& name) {
    return length.unit ? world_units(length.value, *length.unit, unit, name) : length.value;
}

std::string unit_suffix(std::optional<LengthUnit> unit) {
    return unit ? fmt::format(" {}", symbol_of(*unit)) : "";
}

std::int64_t parse_integer(std::string_view option, std::string_view text, std::int64_t lowest,
                           std::int64_t highest) {
    std::int64_t value = 0;
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc() || rest != end || value < lowest || value > highest) {
        fail(option, text, fmt::format("an integer from {} to {}", lowest, highest));
    }
    return value;
}

std::vector<double> parse_numbers(std::string_view option, std::string_view text, std::size_t count,
                                  std::string_view form) {
    const std::vector<std::string_view> parts = split(text, ',');
    if (parts.size() != count) {
        fail(option, text, fmt::format("{}, {} numbers with commas between them", form, count));
    }
    std::vector<double> values;
    for (const std::string_view part : parts) {
        std::string_view rest = part;
        double value = 0;
        if (!leading_number(rest, value) || !rest.empty()) {
            fail(option, text, fmt::format("{}, finite numbers without blanks", form));
        }
        values.push_back(value);
    }
    return values;
}

Double3 parse_double3(std::string_view option, std::string_view text) {
    const std::vector<double> v = parse_numbers(option, text, 3, "X,Y,Z");
    return {v[0], v[1], v[2]};
}

Int3 parse_int3(std::string_view option, std::string_view text, std::int64_t highest) {
    const std::vector<std::string_view> parts = split(text, ',');
    if (parts.size() != 3) {
        fail(option, text, "X,Y,Z, three integers with commas between them");
    }
    return {parse_integer(option, parts[0], 1, highest),
            parse_integer(option, parts[1], 1, highest),
            parse_integer(option, parts[2], 1, highest)};
}

std::vector<int> parse_size(std::string_view option, std::string_view text, int highest) {
    const std::vector<std::string_view> parts = split(text, 'x');
    if (parts.size() != 2) {
        fail(option, text, "WIDTHxHEIGHT, such as 800x600");
    }
    return {static_cast<int>(parse_integer(option, parts[0], 1, highest)),
            static_cast<int>(parse_integer(option, parts[1], 1, highest))};
}

std::string human_bytes(double bytes) {
    return human(bytes, 1000, "B", "B");
}

std::string human_count(double count) {
    std::string text = human(count, 1000, "", "");
    return text;
}

std::string human_range(double low, double high) {
    if (!(low <= high)) {
        return "none";
    }
    constexpr int kFewest = 6;
    constexpr int kMax = 17;
    constexpr double kClose = 0.01;  // relative to high - low
    for (int digits = kFewest;; ++digits) {
        const std::string a = fmt::format("{:.{}g}", low, digits);
        const std::string b = fmt::format("{:.{}g}", high, digits);
        const double off = std::fabs(std::strtod(a.c_str(), nullptr) - low) +
                           std::fabs(std::strtod(b.c_str(), nullptr) - high);
        if (digits == kMax || low == high || off <= kClose * (high - low)) {
            return fmt::format("{} to {}", a, b);
        }
    }
}

std::string value_text(bool are_labels, double low, double high) {
    return are_labels && low <= high
               ? fmt::format("labels {} to {}", label_of_value(low), label_of_value(high))
               : "values " + human_range(low, high);
}

std::string human_value(double value, double apart) {
    constexpr int kFewest = 6;
    constexpr int kMax = 17;
    const double digits = std::ceil(std::log10(std::fabs(value) / apart)) + 1;
    const bool known = apart > 0 && std::isfinite(digits);
    return fmt::format("{:.{}g}", value,
                       known ? std::clamp(static_cast<int>(digits), kFewest, kMax) : kFewest);
}

std::string human_seconds(double seconds) {
    if (seconds < 10) {
        return fmt::format("{:.{}f} s", seconds, seconds < 0.1 ? 3 : 1);
    }
    if (seconds < 60) {
        return fmt::format("{:.0f} s", seconds);
    }
    const auto whole = static_cast<std::int64_t>(std::llround(seconds));
    if (whole < 3600) {
        return fmt::format("{}:{:02}", whole / 60, whole % 60);
    }
    return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
}

}  // namespace isonest::detail::cli
