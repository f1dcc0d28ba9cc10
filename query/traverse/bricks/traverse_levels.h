// AdaptTraverse over bricks, from the coarsest cube down to the levels where nodes stop.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2. A brick receives lists of cubes of the level
// above that are to be refined, marches what stops, and passes lists to its up to eight children
// (BrickTraversal). This file determines the order in which bricks are processed.
#pragma once

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// Extracts the surfaces of all runs, or their plane: depth first if the store is local, level by
/// level if it is remote. Throws what the chunk source and the sinks throw, and Error{cancelled}.
void traverse_levels(Runs runs, std::uint64_t progress_share);

}  // namespace isonest::detail
