// Indicators in 16 bits, rounded up by a monotone rule, so that saturation and every bound survive
// (method: section 5 of the paper needs eta(parent) >= eta(child), and a bound may only grow).
#pragma once

#include <bit>
#include <cstdint>

namespace isonest::detail {

/// The upper half of an IEEE binary32 ("bfloat16"): 1 sign, 8 exponent, 7 fraction bits, the last
/// two of which are 0: they would be noise that no codec makes smaller.
using IndicatorCode = std::uint16_t;
inline constexpr int kCodeFractionBits = 5;
/// Between two codes; the code of infinity.
inline constexpr IndicatorCode kCodeStep = 1U << (7 - kCodeFractionBits);
inline constexpr IndicatorCode kInfinityCode = 0x7F80;
/// How much larger a code's value can be, relative to a normal number.
inline constexpr double kCodeExcess = 1.0 / (1 << kCodeFractionBits);

/// The smallest binary32 that is >= value. REQUIRES: value >= 0 or +inf.
inline float round_up_to_float(double value) {
    const auto f = static_cast<float>(value);
    const std::uint32_t up = static_cast<double>(f) < value ? 1U : 0U;
    return std::bit_cast<float>(std::bit_cast<std::uint32_t>(f) + up);
}
inline float round_up_to_float(float value) {
    return value;
}

/// The smallest code whose value is >= value. REQUIRES: value >= 0 or +inf.
inline IndicatorCode encode_indicator(float value) {
    constexpr std::uint32_t kRest = (std::uint32_t{kCodeStep} << 16U) - 1;
    return static_cast<IndicatorCode>(((std::bit_cast<std::uint32_t>(value) + kRest) & ~kRest) >>
                                      16U);
}

/// The exact value of a code, or of an indicator stored as binary32.
constexpr float decode_indicator(IndicatorCode code) {
    return std::bit_cast<float>(static_cast<std::uint32_t>(code) << 16);
}
inline float decode_indicator(float value) {
    return value;
}

}  // namespace isonest::detail
