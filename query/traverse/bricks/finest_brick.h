// The surface at full resolution: what AdaptTraverse does where no node stops, in a brick of level
// 0, from the values alone.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2 with epsilon = 0: every element of interest is
// refined to the finest grid, so the coarser levels and their indicators need not be read.
#pragma once

#include "query/traverse/bricks/surface_cubes.h"
#include "query/traverse/traversal_run.h"

namespace isonest::detail {

/// Marches all cubes of a brick that the isosurface of the data passes through. `cubes`: those of
/// level 1, from surface_cubes(). Whole cubes by a table, and by single tetrahedra where a value is
/// the isovalue or missing, or if the query culls or asks for leaves. REQUIRES: the query has no
/// plane. Throws what the chunk source and the sink throw.
void march_finest_brick(TraversalRun& run, const Int3& brick, const MaskList& cubes);

}  // namespace isonest::detail
