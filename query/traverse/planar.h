// AdaptTraverse on nested triangles and quadrilaterals, for stores with one flat axis.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1, 2 and 5, in two dimensions: the first
// examples of the paper are a map and a concentration on a square.
#pragma once

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// What to make from the elements.
enum class PlanarKind {
    isolines,  ///< {U = iso}: line segments, as triangles whose last two corners are equal
    graph      ///< the surface z = U over the plane
};

/// Visits all elements that may contain the requested surface: triangles or, for a graph with
/// hexahedra as the query's cells, quadrilaterals. Quadrilaterals give the surface z = P U as
/// triangles whose corners are nodes: a cell without smaller neighbours is split along the diagonal
/// whose ends differ least, other cells into triangles around their centre. So there are no cracks;
/// the error bound is that of P U, which is bilinear in a cell. Nodes with missing values leave
/// holes. A graph's third coordinate is U itself. Deterministic. REQUIRES: the lattice has
/// dimension 2, and for a graph its flat axis is z; for quadrilaterals the tolerance is the same
/// everywhere. Throws as traverse() does.
TraversalCounts traverse_planar(TraversalRun& run, PlanarKind kind);

}  // namespace isonest::detail
