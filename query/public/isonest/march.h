// Surfaces directly from a volume, without a store: for volumes that are used only once.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <utility>

#include <isonest/extract.h>
#include <isonest/mesh_sink.h>
#include <isonest/volume_source.h>

namespace isonest {

struct MarchQuery {
    double iso = 0;
    bool normals = false;  ///< at the vertices, from the data's gradient
};

/// Memory for a mesh, owned by the caller.
struct MeshRoom {
    std::span<std::array<float, 3>> vertices = {};  ///< world coordinates x, y, z
    std::span<std::array<std::uint32_t, 3>> triangles = {};
    std::span<std::array<float, 3>> normals = {};  ///< empty if the layout has none
};
/// Provides memory for layout.vertices vertices and layout.elements triangles. The initial contents
/// do not matter. Called once.
using MakeRoom = std::function<MeshRoom(const MeshLayout& layout)>;

/// Extracts the surface {U = iso} of hexahedral cells at full resolution. The triangles are those
/// that extract() makes from a store of the volume with Cells::hexahedra and an error of 0, in
/// another order. They face smaller values; cells with a missing corner have none. (Triangles that
/// lose their area in float32 are repaired in that other order, which may lead to a different
/// repair.)
///
/// Triangles are ordered by cell, x fastest, then y, then z; vertices are in the order of their
/// first use. The mesh does not depend on threads or memory. The volume is read once, in ascending
/// order, or accessed in place if it is memory-mapped.
///
/// Memory besides the volume and the mesh: a second copy of the mesh while it is assembled, the
/// neighbourhood of repaired triangles, and a few planes per thread. `options.memory` limits only
/// the last of these.
///
/// Throws Error{invalid_argument} for an isovalue that is not finite, a volume with one node along
/// an axis, or one with an invalid position; Error{unsupported} for 64-bit labels and for a volume
/// that is not aligned with the world's axes; Error{limit} if the planes need more memory or vertex
/// numbers exceed 32 bits; Error{cancelled}, and what reading the volume and `make_room` throw.
/// Thread-safety: any number of concurrent calls, each with its own volume.
ExtractReport march_hexahedra(VolumeSource& volume, const MarchQuery& query,
                              const MakeRoom& make_room, const ExtractOptions& options = {},
                              Progress& progress = silent_progress());
/// The same, into the vectors of a collector. It gets begin(), but no batches.
ExtractReport march_hexahedra(VolumeSource& volume, const MarchQuery& query, MeshCollector& mesh,
                              const ExtractOptions& options = {},
                              Progress& progress = silent_progress());

/// Extracts the surface at full resolution into a sink, with the other options of a query: closed,
/// clipped by a box, with selected components, simplified within a distance or to a triangle
/// budget; of hexahedra, or of tetrahedra if requested. The mesh is byte for byte that of a store
/// queried for the same cells. Exception: the surface of hexahedra with none of these options is
/// the mesh of march_hexahedra(). Options that need a store (an error, a field, a focus, vertex
/// values ...) throw Error{invalid_argument} with RemedyKind::make_store. The volume need not be
/// aligned with the world's axes. The mesh does not depend on threads or memory.
///
/// `options.memory` limits the heap, except for what the sink stores: data that grows with the mesh
/// is kept in temporary files. The volume is read once, in ascending order, or accessed in place if
/// it is memory-mapped.
///
/// Throws what march_hexahedra() throws for the volume, and what extract() throws for a store.
/// Thread-safety: any number of concurrent calls, each with its own volume and sink.
ExtractReport extract(VolumeSource& volume, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// Minimum ExtractOptions::memory, in bytes, for march_hexahedra(). Nothing if the volume must be
/// converted to a store because march_hexahedra() would reject it.
std::optional<std::uint64_t> march_memory(VolumeSource& volume);
/// The same for extract(), which also accepts volumes that are not aligned with the world's axes.
/// Also returns nothing if the query needs a store, that is, if extract() would reject it with
/// RemedyKind::make_store. Stages may need more, as for a store's surface. Reads no data.
std::optional<std::uint64_t> march_memory(VolumeSource& volume, const SurfaceQuery& query);

/// The smallest and the largest finite value; nothing if there is none. The volume is read once, in
/// ascending order, or accessed in place. Throws Error{limit, cancelled}, and what reading throws.
std::optional<std::pair<double, double>> finite_range(VolumeSource& volume,
                                                      const ExtractOptions& options = {},
                                                      Progress& progress = silent_progress());

}  // namespace isonest
