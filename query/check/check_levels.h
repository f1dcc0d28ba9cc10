// The levels of a store against each other, chunk by chunk.
#pragma once

#include "query/check/findings.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Tests "injection" of values, "saturation" of indicators across chunk borders, and "indicator" of
/// those at level 1 that follow from the values. Adds what it finds to `findings`.
/// Throws Error{corrupt} if a chunk that it needs cannot be decoded. Thread-safe.
void check_levels(ChunkCache& cache, Findings& findings, const ArrayInfo& array, const Int3& chunk);

}  // namespace isonest::detail
