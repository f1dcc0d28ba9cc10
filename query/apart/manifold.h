// Makes a mesh of triangles a manifold with border: gives each sheet its own vertices where sheets
// touch in an edge or a vertex.
//
// A label that touches itself along an edge of its voxels has four triangles at that edge of its
// mesh. Two of them bound one part of the solid, two the other; each pair gets its own edge.
//
// Source: A. Gueziec, G. Taubin, F. Lazarus, W. Horn, "Cutting and stitching: converting sets of
// polygons to manifold surfaces", IEEE TVCG 7 (2001): local cutting. The pairs at an edge are those
// around the same part of the solid; where a sheet would touch itself at both ends of the edge, the
// other pairs.
#pragma once

#include <cstdint>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Meshes with at most this many triangles need no files.
inline constexpr std::uint64_t kManifoldInHeap = std::uint64_t{1} << 14U;

/// Where a mesh is not a manifold.
struct SharedPlaces {
    std::uint64_t edges = 0;     ///< with more than two triangles
    std::uint64_t vertices = 0;  ///< where triangles meet that no chain of common edges connects
};

/// Counts them. `corners`: of triangles, below `vertices`. Data that grows with the mesh is kept in
/// temporary files in `folder`. Throws Error{io, cancelled}.
SharedPlaces shared_places(std::uint64_t vertices, const CornerView& corners,
                           const ScratchFolder& folder, const Progress& progress);

/// Copies vertices until every edge has at most two triangles and the triangles at every vertex are
/// one fan. The fan with the first triangle keeps the vertex; the others get copies at the same
/// place, in the order of vertices and first triangles. Returns the number of copies. The result
/// depends on the mesh alone. REQUIRES: three different corners in each triangle; at an edge with
/// more than two triangles, the numbers of those in one and in the other direction differ by at
/// most one. Throws Error{io, cancelled}.
std::uint64_t make_manifold(ScratchMesh& mesh, const ScratchFolder& folder,
                            const Progress& progress);

}  // namespace isonest::detail
