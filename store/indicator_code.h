// Indicators in 16 bits, rounded up by a monotone rule, so that saturation and every bound survive
// (method: section 3 of the paper needs eta(parent) >= eta(child), and a bound may only grow).
#pragma once

#include <bit>
#include <cstdint>

namespace isonest {

/// The upper half of an IEEE binary32 ("bfloat16"): 1 sign, 8 exponent, 7 fraction bits.
using IndicatorCode = std::uint16_t;

/// The smallest binary32 that is >= value. REQUIRES: value >= 0 or +inf.
inline float round_up_to_float(double value) {
    const auto f = static_cast<float>(value);
    const std::uint32_t up = static_cast<double>(f) < value ? 1U : 0U;
    return std::bit_cast<float>(std::bit_cast<std::uint32_t>(f) + up);
}
inline float round_up_to_float(float value) {
    return value;
}

/// The smallest code whose value is >= value; at most a factor 1 + 2^-7 above for normal numbers.
/// REQUIRES: value >= 0 or +inf.
inline IndicatorCode encode_indicator(float value) {
    return static_cast<IndicatorCode>((std::bit_cast<std::uint32_t>(value) + 0xFFFFU) >> 16);
}

/// The exact value of a code, or of an indicator stored as binary32.
inline float decode_indicator(IndicatorCode code) {
    return std::bit_cast<float>(static_cast<std::uint32_t>(code) << 16);
}
inline float decode_indicator(float value) {
    return value;
}

}  // namespace isonest
