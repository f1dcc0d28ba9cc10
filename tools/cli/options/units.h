// Parses numbers on a command line, and formats numbers for people.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>

namespace isonest::detail::cli {

// Parsers consume the whole text or throw Error{invalid_argument}; `option` ("--iso") starts the
// message.

/// A length with its unit, "0.5mm"; without a unit, a plain number.
struct Length {
    double value = 0;
    std::optional<LengthUnit> unit = {};
    bool voxels = false;  ///< "0.5voxel"; there is no unit then
};
/// A length >= 0. Throws Error{invalid_argument}, which lists the units, if the unit is unknown.
Length parse_length(std::string_view option, std::string_view text);
/// The length in the unit of a volume. Throws Error{invalid_argument} if the length has a unit but
/// the volume has none; `name`: of the volume's file. REQUIRES: the length is not in voxels.
double in_world_units(const Length& length, std::optional<LengthUnit> unit,
                      const std::string& name);
/// " mm", to append to a length; empty if the unit is unknown.
std::string unit_suffix(std::optional<LengthUnit> unit);

/// "512M", "2G", "1GiB", "1.5g" or plain bytes. K, M, G and T are powers of 1024, with or without
/// "iB" or "B".
std::uint64_t parse_bytes(std::string_view option, std::string_view text);
/// A finite number.
double parse_number(std::string_view option, std::string_view text);
/// An integer in [lowest, highest].
std::int64_t parse_integer(std::string_view option, std::string_view text, std::int64_t lowest,
                           std::int64_t highest);
/// Exactly `count` finite numbers separated by commas; `form` ("X,Y,Z") is shown in the message.
std::vector<double> parse_numbers(std::string_view option, std::string_view text, std::size_t count,
                                  std::string_view form);
/// "X,Y,Z".
Double3 parse_double3(std::string_view option, std::string_view text);
/// "X,Y,Z", integers in [1, highest].
Int3 parse_int3(std::string_view option, std::string_view text, std::int64_t highest);
/// "WIDTHxHEIGHT", each in [1, highest].
std::vector<int> parse_size(std::string_view option, std::string_view text, int highest);

/// "1.2 GB", "640 B": powers of 1000, three digits.
std::string human_bytes(double bytes);
/// "1.2 M", "640": powers of 1000, three digits.
std::string human_count(double count);
/// "1000000000 to 1000000003": six digits, or as many as are needed to tell the ends apart and show
/// their difference to 1 %; "none" unless low <= high.
std::string human_range(double low, double high);
/// "values 0 to 255", or "labels 0 to 720575940627185911" for labels of 64 bits. `low`, `high`: as
/// returned by StoreReader.
std::string value_text(bool are_labels, double low, double high);
/// "616.5": six digits, or as many as are needed to distinguish `value` from `value` + `apart`.
std::string human_value(double value, double apart);
/// "0.4 s", "2:05", "1:02:05".
std::string human_seconds(double seconds);

}  // namespace isonest::detail::cli
