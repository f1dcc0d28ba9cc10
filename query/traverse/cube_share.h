// Which part of a traversal one of several ranks does.
//
// Cells of the finest lattice in Morton order; a rank has a range of them, and all cubes of any
// level whose first cell is in it. So ranges that follow each other share the work without a
// message, and a range's border passes through one cube of each level at most.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include <isonest/int3.h>

#include "query/view/morton.h"

namespace isonest::detail {

/// The cells [begin, end). REQUIRES: each is a multiple of the cells in a cube of level 1.
struct CubeShare {
    /// More than there are cells.
    static constexpr std::uint64_t kEnd = std::uint64_t{1} << 63U;
    std::uint64_t begin = 0;
    std::uint64_t end = kEnd;

    [[nodiscard]] bool is_whole() const { return begin == 0 && end == kEnd; }
    [[nodiscard]] bool is_empty() const { return begin >= end; }
    /// Whether a cube of edge 2^level, `at` in cubes, is this rank's.
    [[nodiscard]] bool owns(int level, const Int3& at) const {
        const std::uint64_t first = morton_code(at) << cell_bits(level);
        return begin <= first && first < end;
    }
    /// Whether some of its cells are.
    [[nodiscard]] bool meets(int level, const Int3& at) const {
        const std::uint64_t first = morton_code(at) << cell_bits(level);
        return first < end && begin < first + (std::uint64_t{1} << cell_bits(level));
    }
    /// Of `count` cubes from the one with Morton code `first` on, which meet the range: first and
    /// end, counted from `first`.
    [[nodiscard]] std::pair<std::size_t, std::size_t> meeting(int level, std::uint64_t first,
                                                              std::size_t count) const {
        const std::uint64_t low = begin >> cell_bits(level);
        const std::uint64_t high =
            (end + (std::uint64_t{1} << cell_bits(level)) - 1) >> cell_bits(level);
        const auto within = [&](std::uint64_t code) {
            return static_cast<std::size_t>(
                std::min<std::uint64_t>(code > first ? code - first : 0, count));
        };
        return {within(low), within(high)};
    }

  private:
    /// Bits of a Morton code that say which of a cube's cells; a coarser cube has all there are.
    static constexpr unsigned cell_bits(int level) {
        return std::min(3U * static_cast<unsigned>(level), 63U);
    }
};

}  // namespace isonest::detail
