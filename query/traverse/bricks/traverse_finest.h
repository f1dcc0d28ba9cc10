// Full resolution: the bricks of level 0 that intersect the surface, by the chunk table and the
// values alone.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2 with epsilon = 0, and section 5, the interest
// test with beta_0 = 0: no node stops, so no coarser level is needed.
#pragma once

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// Extracts the surfaces of all runs. REQUIRES: run.is_finest(). Throws what the chunk source and
/// the sinks throw, and Error{cancelled}.
void traverse_finest(Runs runs, std::uint64_t progress_share);

/// For volumes of which only a layer is in memory: the parts that traverse() makes of the bricks of
/// level 0 whose chunks are in layer `layer` along z, with the same sort numbers. The cache's
/// source must have the chunks of that layer, and the adjacent nodes of the neighbouring layers:
/// two planes after it and one before. REQUIRES: run.is_finest(), no share. Runs in the arena of
/// the caller. Throws as traverse() does.
TraversalCounts traverse_finest_layer(TraversalRun& run, std::int64_t layer);

}  // namespace isonest::detail
