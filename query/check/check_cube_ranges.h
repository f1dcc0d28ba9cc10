// The ranges of the cubes against the values that they bound.
#pragma once

#include <isonest/progress.h>

#include "query/check/findings.h"
#include "query/check/rank_share.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Compares the planes of ranges with their checksums (if `quick`: a sample of at most 256 MiB)
/// and, unless `quick`, the ranges with the values of level 0 and with those of the finer level.
/// Adds what it finds to `findings`, as test "cube range". Of ranks each compares its share;
/// collective then. Of a store that is far, ranges that are not read are not checked. Throws
/// Error{cancelled}.
void check_cube_ranges(const StoreReader& store, ChunkCache& cache, bool quick, Findings& findings,
                       Progress& progress, const RankShare& share);

}  // namespace isonest::detail
