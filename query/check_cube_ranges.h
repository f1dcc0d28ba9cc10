// The ranges of the cubes against the values that they bound.
#pragma once

#include "query/findings.h"
#include "store/chunk_cache.h"
#include "store/progress.h"
#include "store/reader.h"

namespace isonest {

/// Compares the planes of ranges with their checksums (if `quick`: a sample of at most 256 MiB)
/// and, unless `quick`, the ranges with the values of level 0 and with those of the finer level.
/// Adds what it finds to `findings`, as test "cube range". Throws Error{cancelled}.
void check_cube_ranges(const StoreReader& store, ChunkCache& cache, bool quick, Findings& findings,
                       Progress& progress);

}  // namespace isonest
