// AdaptTraverse on hexahedral cells: isosurfaces and slices.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 2, with cells that are refined into eight
// instead of tetrahedra that are bisected.
#pragma once

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// Like traverse(), for queries with Cells::hexahedra: the surface {P U = iso}, or the plane, in
/// the cells given by the stop field and the tolerance. The value at a vertex is that of P U.
/// REQUIRES: a volume; the tolerance is the same everywhere; the query has neither culling nor
/// on_leaf, and its box is not closed. Throws what the chunk source and the sink throw, and
/// Error{cancelled}.
TraversalCounts traverse_hexahedra(TraversalRun& run);

}  // namespace isonest::detail
