// Gives each fan of triangles its own vertex where several fans meet in one that lies in a face of
// the box: where a sheet leaves the box at a vertex and returns at the same one.
//
// A sheet has one vertex at a node, or on an edge, through which it passes. An element that extends
// beyond the box is marched as a whole and cut at the face, and so is the disk of triangles around
// the vertex; what is left may be several disks that have only the vertex in common.
#pragma once

#include <cstdint>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/mesh/vertex_stars.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The fan with the first triangle keeps the vertex; the others get copies of it, in the order of
/// their first triangles. Returns the number of copies. Data that grows with the mesh is kept in
/// temporary files in `folder`, except for the triangles around one vertex. REQUIRES: triangles, no
/// two of which use an edge in the same direction. Throws Error{io, cancelled}.
std::uint64_t split_fans(ScratchMesh& mesh, const BoxFaces& faces, const ScratchFolder& folder,
                         Progress& progress);

}  // namespace isonest::detail
