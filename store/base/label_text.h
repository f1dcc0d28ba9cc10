// Labels: 64-bit numbers as values, and names as text.
#pragma once

#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include <isonest/label_name.h>

namespace isonest::detail {

// 64-bit labels as values: a float64 whose bits are the sum of the bits of 1.0 and the label. So
// labels have the order of their values, and no value is missing or denormal (slow on processors).

inline constexpr std::uint64_t kFirstLabelBits = 0x3FF0000000000000;  ///< of 1.0
/// The largest possible label: 2^62 - 1. Its value is the largest finite value.
inline constexpr std::uint64_t kMaxLabel = 0x3FFFFFFFFFFFFFFF;

/// REQUIRES: label <= kMaxLabel.
inline double value_of_label(std::uint64_t label) {
    return std::bit_cast<double>(kFirstLabelBits + label);
}
/// REQUIRES: value represents a label.
inline std::uint64_t label_of_value(double value) {
    return std::bit_cast<std::uint64_t>(value) - kFirstLabelBits;
}

// Names of labels as text.

/// Whether this is UTF-8 without control characters, and without what XML cannot hold (U+FFFE,
/// U+FFFF). Source: Unicode Standard 15, table 3-7.
bool is_printable_utf8(std::string_view text);

/// Why a store cannot hold these names; empty if it can. They must be sorted by ascending ids.
std::string why_no_label_names(std::span<const LabelName> names);

}  // namespace isonest::detail
