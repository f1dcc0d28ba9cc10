// Takes the triangles out of a mesh that have no area because float32 rounds their corners to one
// place or onto a line.
//
// What changes no geometry comes first: an edge between two vertices at one place is collapsed; of
// three corners on a line, the longest side is flipped to the corner across, so that the middle one
// becomes a vertex of the neighbour; where that side is a border, the triangle goes. All that only
// where the topology stays (query/mesh/link_condition.h). Where nothing of it can be done, a vertex
// is moved by units in the last place (query/mesh/nudge_vertex.h). Each step leaves fewer triangles
// without area, or fewer of them that are points, so that there is an end.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The least step that is used, in distances between nodes: no more than float32 rounds coordinates
/// in volumes of 16 nodes along an axis.
inline constexpr double kLeastNudge = 0x1p-20;

struct MendedTriangles {
    std::uint64_t found = 0;  ///< triangles without area
    std::uint64_t left = 0;
    std::uint64_t moved_vertices = 0;
    Double3 moved{};  ///< most by which a coordinate changed, world units
};

/// Mends `mesh`; triangles and vertices that are left keep their order. `least_step`: no vertex is
/// moved by less along an axis; world units, >= 0. What grows with the mesh lies in temporary files
/// in `folder`. The result depends on the mesh and `least_step` alone. REQUIRES: triangles. Throws
/// Error{io, cancelled}.
MendedTriangles mend_triangles(ScratchMesh& mesh, const Double3& least_step,
                               const ScratchFolder& folder, Progress& progress);

/// The same of a mesh in memory, whose triangles are not taken out: those that are to go have
/// kNoTriangle in place of a corner, and vertices that no other one names stay. `moved_vertices`
/// gets the vertices that were moved. `lo`, `hi`: the box of the mesh. Where few triangles are to
/// be mended, all threads of the arena look for them.
inline constexpr std::uint32_t kNoTriangle = 0xFFFFFFFFU;
MendedTriangles mend_triangles(std::span<std::array<float, 3>> positions,
                               std::span<std::array<std::uint32_t, 3>> triangles,
                               const std::array<float, 3>& lo, const std::array<float, 3>& hi,
                               const Double3& least_step,
                               std::vector<std::uint32_t>& moved_vertices,
                               const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
