// Marching cubes with exact hits.
#pragma once

#include <vector>

#include "query/march/finish_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

/// Adds the surface's triangles in a hexahedral cell: a corner is inside if its value is not below
/// the isovalue; the triangles' normals point to the smaller values. Where the surface passes
/// exactly through corners, no triangle of zero area arises and the mesh stays a manifold. `cut`:
/// the cell may reach out of the box. `nodes`: as PolygonWithHits takes them. False if the surface
/// does not pass through. REQUIRES: place() was called; the cube is not mirrored, its values are
/// finite.
bool march_hexahedron(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                      std::vector<CollectedTriangle>& triangles, unsigned nodes = 0xFF);

/// The same if no corner has the isovalue.
bool march_hexahedron_without_hits(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                                   std::vector<CollectedTriangle>& triangles);

}  // namespace isonest::detail
