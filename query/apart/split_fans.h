// Gives each fan of triangles a vertex of its own where several meet in one that lies in a face of
// the box: where a sheet leaves the box at a vertex and comes back at the same one.
//
// A sheet has one vertex in a node, or on an edge, that it passes through. An element that reaches
// beyond the box is marched as a whole and cut at the face, and so is the disk of triangles around
// the vertex; what is left of it may be several disks that have the vertex alone in common.
#pragma once

#include <array>
#include <cstdint>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The planes of the faces, world coordinates as rounded.
struct BoxFaces {
    std::array<float, 3> low{};
    std::array<float, 3> high{};
};

/// The fan with the first triangle keeps the vertex; the others get copies of it, in the order of
/// their first triangles. Returns how many. What grows with the mesh lies in temporary files in
/// `folder`, but for the triangles around one vertex. REQUIRES: triangles, of which
/// no two run through an edge in the same direction. Throws Error{io, cancelled}.
std::uint64_t split_fans(ScratchMesh& mesh, const BoxFaces& faces, const ScratchFolder& folder,
                         Progress& progress);

}  // namespace isonest::detail
