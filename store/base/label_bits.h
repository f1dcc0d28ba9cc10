// Labels of 64 bits as values: float64 whose bits are those of 1.0 and the label. So labels have
// the order of their values, and no value is missing or as small as processors are slow with.
#pragma once

#include <bit>
#include <cstdint>

namespace isonest::detail {

inline constexpr std::uint64_t kFirstLabelBits = 0x3FF0000000000000;  ///< of 1.0
/// The largest label that there can be: 2^62 - 1. Its value is the largest of all finite ones.
inline constexpr std::uint64_t kMostLabel = 0x3FFFFFFFFFFFFFFF;

/// REQUIRES: label <= kMostLabel.
inline double value_of_label(std::uint64_t label) {
    return std::bit_cast<double>(kFirstLabelBits + label);
}
/// REQUIRES: value is one of a label.
inline std::uint64_t label_of_value(double value) {
    return std::bit_cast<std::uint64_t>(value) - kFirstLabelBits;
}

}  // namespace isonest::detail
