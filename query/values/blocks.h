// Divides a large box into small boxes, in an order that needs few chunks at a time.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

// The Z-order of cubes: x is the lowest bit.

/// Spreads the low 21 bits of v so that each is followed by two zero bits.
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

/// Default edge of the boxes of for_each_block().
inline constexpr std::int64_t kBlockEdge = 32;

/// Calls f(lo, size) for boxes of at most `edge` nodes per axis that fill the box of `size` nodes
/// starting at `lo`, chunk by chunk of `chunk` nodes counted from `lo`, so that each chunk is
/// needed only once.
template <class F>
void for_each_block(const Int3& lo, const Int3& size, const Int3& chunk, const F& f,
                    std::int64_t edge = kBlockEdge) {
    const Int3 edges{edge, edge, edge};
    const Int3 chunks = ceil_div(size, chunk);
    for (std::int64_t c = 0; c < chunks.product(); ++c) {
        const Int3 i = chunks.unlinear(c);
        const Int3 first{i.x * chunk.x, i.y * chunk.y, i.z * chunk.z};
        const Int3 all = min(chunk, size - first);
        const Int3 blocks = ceil_div(all, edges);
        for (std::int64_t b = 0; b < blocks.product(); ++b) {
            const Int3 from = blocks.unlinear(b) * edge;
            f(lo + first + from, min(edges, all - from));
        }
    }
}

}  // namespace isonest::detail
