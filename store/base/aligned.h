// Places in memory and in files of our own at which numbers of 64 bits may lie.
#pragma once

#include <cstdint>

namespace isonest::detail {

/// The smallest multiple of 8 that is no less.
constexpr std::uint64_t aligned(std::uint64_t bytes) {
    return (bytes + 7) / 8 * 8;
}

}  // namespace isonest::detail
