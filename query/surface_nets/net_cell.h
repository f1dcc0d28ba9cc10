// One cell of a surface net: to which neighbours its vertex is joined.
//
// Source: S. F. F. Gibson, "Constrained elastic surface nets: generating smooth surfaces from
// binary segmented data", MICCAI 1998.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <limits>

namespace isonest::detail {

/// What a node beyond the volume's border has in place of a label, and one whose value is missing.
inline constexpr std::int64_t kOutsideLabel = std::numeric_limits<std::int64_t>::min();
inline constexpr std::int64_t kMissingLabel = kOutsideLabel + 1;

/// Whether it is the label of nodes.
inline bool has_mesh(std::int64_t label) {
    return label != kOutsideLabel && label != kMissingLabel;
}

/// Of the corners of a cell: number x + 2 y + 4 z.
using CellLabels = std::array<std::int64_t, 8>;

/// The cells across its faces, bit 2 axis + (0 low, 1 high), with whose vertices the vertex of a
/// cell is averaged: those to which a mesh edge leads, which are the faces whose corners have
/// different labels. On lines where more than two sheets meet, which are the faces with more than
/// two sides that labels cross, those along the line alone, if the line goes on in two of them: so
/// the line is smoothed as a line, and no sheet pulls it to its side.
inline std::uint8_t neighbours_of(const CellLabels& label) {
    unsigned all = 0;
    unsigned lines = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned u = 1U << ((axis + 1) % 3);
        const unsigned v = 1U << ((axis + 2) % 3);
        for (unsigned side = 0; side < 2; ++side) {
            const unsigned first = side << axis;
            const unsigned crossed = (label[first] != label[first | u] ? 1U : 0U) +
                                     (label[first] != label[first | v] ? 1U : 0U) +
                                     (label[first | u] != label[first | u | v] ? 1U : 0U) +
                                     (label[first | v] != label[first | u | v] ? 1U : 0U);
            const unsigned bit = 1U << (2 * axis + side);
            all |= crossed > 0 ? bit : 0;
            lines |= crossed > 2 ? bit : 0;
        }
    }
    return static_cast<std::uint8_t>(std::popcount(lines) > 1 ? lines : all);
}

}  // namespace isonest::detail
