// The range of the values within each cube: see store/container/cube_range.h.
#pragma once

#include <span>

#include "store/base/box.h"
#include "store/container/cube_range.h"

namespace isonest::detail {

/// Of the cubes of level kFirstRangeLevel in `to`. `values` are those of level 0, with all nodes of
/// the cubes as far as they are <= `last`. Thread-safe.
template <class T>
void find_cube_ranges(const Box<T>& values, const Int3& last, Box<CubeRange>& to);

/// Those of a level from those of the level below; cubes [z][y][x].
void merge_cube_ranges(std::span<const CubeRange> fine, const Int3& fine_cells,
                       std::span<CubeRange> coarse, const Int3& coarse_cells);

}  // namespace isonest::detail
