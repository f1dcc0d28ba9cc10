// The surface of hexahedral cells at full resolution, in a brick of level 0.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 2 with epsilon = 0: cells of the nested
// hexahedral grid are cubes, and every one of interest is refined to the finest grid.
#pragma once

#include "query/traverse/bricks/surface_cubes.h"
#include "query/traverse/traversal_run.h"

namespace isonest::detail {

/// Marches all cubes of a brick that the isosurface passes through, or a cap of a closed box, each
/// as one cell. `cubes`: those of level 1, from surface_cubes(). Cells with a missing corner have
/// neither. REQUIRES: the query has neither plane nor culling nor on_leaf. Throws what the chunk
/// source and the sink throw.
void march_finest_hexahedra(TraversalRun& run, const Int3& brick, const MaskList& cubes);

}  // namespace isonest::detail
