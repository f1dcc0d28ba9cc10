// Normals where the data's gradient says nothing, because it is 0 or not finite: on plateaus,
// beside missing values, in the middle of a ridge.
//
// Such a vertex has the normal of the triangles around it, each weighted by its area; if they have
// no area either, or cancel each other, the z axis. Of lines it is perpendicular to those around it
// in the plane of the data. The sums run over the triangles in the order of the mesh, so that
// nothing depends on threads or on how the mesh was cut into parts.
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

// What grows with the mesh lies in temporary files: two bits for each vertex, and 24 bytes for each
// that has no normal. All do nothing to a mesh without normals, and throw Error{io, cancelled}.

/// Of a welded mesh, in each part's copy of a vertex. REQUIRES: if `layout` has normals, the parts
/// were counted by PartStore::count_normals().
void complete_normals(PartStore& parts, const VertexNumbers& weld, const MeshLayout& layout,
                      const ScratchFolder& folder, Progress& progress);
/// Of the vertices that `elements` name.
void complete_normals(ScratchMesh& mesh, const CornerView& elements, const ScratchFolder& folder,
                      Progress& progress);
/// Of triangles in memory.
void complete_normals(std::span<const std::array<float, 3>> positions,
                      std::span<const std::array<std::uint32_t, 3>> triangles,
                      std::span<std::array<float, 3>> normals, const ScratchFolder& folder,
                      Progress& progress);

}  // namespace isonest::detail
