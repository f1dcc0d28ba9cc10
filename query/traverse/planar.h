// AdaptTraverse on nested triangles: stores with one flat axis.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 5, in two dimensions: the paper's own
// first examples are a map and a concentration on a square.
#pragma once

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// What to make of the triangles.
enum class PlanarKind {
    isolines,  ///< {U = iso}: parts of lines, as triangles whose last two corners are equal
    graph      ///< the surface z = U over the plane
};

/// Visits all triangles that may hold what is asked for. Nodes with missing values cut holes. A
/// graph's third coordinate is U itself. Deterministic. REQUIRES: the lattice has
/// dimension 2, and for a graph its flat axis is z. Throws as traverse() does.
TraversalCounts traverse_planar(ChunkCache& cache, const TraversalQuery& query, PlanarKind kind,
                                std::size_t part_vertices, const PartSink& sink,
                                Progress& progress);

}  // namespace isonest::detail
