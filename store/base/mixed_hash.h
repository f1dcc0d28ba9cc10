// A hash for numbers that come in rows. The standard library's leaves a number as it is, and a
// table whose size is a power of two then puts two rows that lie apart into the same slots, one
// behind the other: each look-up goes through thousands of them.
#pragma once

#include <cstddef>
#include <cstdint>

namespace isonest::detail {

struct MixedHash {
    std::size_t operator()(std::uint64_t v) const {
        const std::uint64_t h = v * 0x9E3779B97F4A7C15ULL;
        return static_cast<std::size_t>(h ^ (h >> 32U));
    }
};

}  // namespace isonest::detail
