// Whether a brick of level 0 can hold surface that faces the viewer, before its values are read.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: with beta_1 or beta_N of an element all of
// its descendants are known to face away. Here the elements are the six of each cube of 8^3 cells,
// and the number is that of the cube's centre, which covers everything in the cube. Values and
// bounds of that level are less than a hundredth of those of the finest one.
#pragma once

#include <isonest/int3.h>

#include "query/traverse/traversal_run.h"
#include "store/container/announce/chunk_needs.h"

namespace isonest::detail {

/// Looks at the brick's cubes of level 3, but for those that the isovalue misses by their ranges:
/// first at the gradients of that level alone, and at the bounds only where all of those face away.
/// True where there is no such level. Counts the tetrahedra that it asks. REQUIRES: the query
/// culls. Thread-safe. Throws what the chunk cache throws.
bool may_face_viewer(TraversalRun& run, const Int3& brick);

/// Which chunks that may take.
void add_facing_needs(const TraversalRun& run, const Int3& brick, ChunkNeeds& needs);

}  // namespace isonest::detail
