// Normals where the data's gradient is 0 or not finite: on plateaus, beside missing values, in the
// middle of a ridge.
//
// Such a vertex gets the normal of the triangles around it, weighted by their areas; if they have
// no area either, or cancel each other, the z axis. For lines, it is perpendicular to the lines
// around it, in the plane of the data. The sums are computed in the order of the mesh's triangles,
// so the result does not depend on threads or on the division into parts.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/part_store.h"
#include "query/mesh/scratch_mesh.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Data that grows with the mesh is kept in temporary files: two bits for each vertex, and 24 bytes
// for each vertex without a normal. All functions do nothing for a mesh without normals, and throw
// Error{io, cancelled}.

/// For a welded mesh, in each part's copy of a vertex. REQUIRES: if `layout` has normals, the parts
/// were counted by PartStore::count_normals().
void complete_normals(PartStore& parts, const VertexNumbers& weld, const MeshLayout& layout,
                      const ScratchFolder& folder, Progress& progress);
/// For the vertices used by `elements`.
void complete_normals(ScratchMesh& mesh, const CornerView& elements, const ScratchFolder& folder,
                      Progress& progress);
/// For triangles in memory.
void complete_normals(std::span<const std::array<float, 3>> positions,
                      std::span<const std::array<std::uint32_t, 3>> triangles,
                      std::span<std::array<float, 3>> normals, const ScratchFolder& folder,
                      Progress& progress);

}  // namespace isonest::detail
