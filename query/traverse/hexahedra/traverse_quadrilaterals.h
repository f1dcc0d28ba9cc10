// The graph of data in a plane over the adaptive grid of quadrilaterals.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 2, with cells that are refined into four
// in place of triangles that are bisected.
#pragma once

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// The surface z = P U over the cells that the stop field and the tolerance leave, as triangles
/// whose corners are nodes: a cell without smaller neighbours is cut along the diagonal whose ends
/// differ least, another one into those around its centre. So there are no cracks. The error bound
/// is that of P U, which is bilinear in a cell. Cells with missing values cut holes. Deterministic.
/// REQUIRES: the lattice has dimension 2, and its flat axis is z; the tolerance is the same
/// everywhere. Throws as traverse() does.
TraversalCounts traverse_quadrilaterals(ChunkCache& cache, const TraversalQuery& query,
                                        std::size_t part_vertices, const PartSink& sink,
                                        Progress& progress);

}  // namespace isonest::detail
