// The Z-order of cubes: x is the lowest bit.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// Spreads the low 21 bits of v so that two zero bits follow each.
constexpr std::uint64_t spread_bits(std::uint64_t v) {
    v &= 0x1FFFFFU;
    v = (v | v << 32U) & 0x1F00000000FFFFULL;
    v = (v | v << 16U) & 0x1F0000FF0000FFULL;
    v = (v | v << 8U) & 0x100F00F00F00F00FULL;
    v = (v | v << 4U) & 0x10C30C30C30C30C3ULL;
    v = (v | v << 2U) & 0x1249249249249249ULL;
    return v;
}

/// Inverse of spread_bits().
constexpr std::uint64_t compact_bits(std::uint64_t v) {
    v &= 0x1249249249249249ULL;
    v = (v ^ v >> 2U) & 0x10C30C30C30C30C3ULL;
    v = (v ^ v >> 4U) & 0x100F00F00F00F00FULL;
    v = (v ^ v >> 8U) & 0x1F0000FF0000FFULL;
    v = (v ^ v >> 16U) & 0x1F00000000FFFFULL;
    v = (v ^ v >> 32U) & 0x1FFFFFU;
    return v;
}

/// REQUIRES: 0 <= p < 2^21 per axis.
constexpr std::uint64_t morton_code(const Int3& p) {
    return spread_bits(static_cast<std::uint64_t>(p.x)) |
           spread_bits(static_cast<std::uint64_t>(p.y)) << 1U |
           spread_bits(static_cast<std::uint64_t>(p.z)) << 2U;
}

constexpr Int3 morton_point(std::uint64_t code) {
    return {static_cast<std::int64_t>(compact_bits(code)),
            static_cast<std::int64_t>(compact_bits(code >> 1U)),
            static_cast<std::int64_t>(compact_bits(code >> 2U))};
}

}  // namespace isonest::detail
