// Writes the ranges of cubes: FORMAT.md, "Ranges of cubes".
#pragma once

#include <span>

#include "store/container/cube_range.h"
#include "store/container/format.h"
#include "store/container/writing/written_file.h"

namespace isonest::detail {

/// Those of a level, [z][y][x], with the checksums of their planes. Throws Error{io}.
void write_ranges_of_cubes(const WrittenFile& file, const StoreLayout& layout, int level,
                           std::span<const CubeRange> ranges);

}  // namespace isonest::detail
