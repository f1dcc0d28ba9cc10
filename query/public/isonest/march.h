// Surfaces straight from a volume, without a store: for volumes that are looked at once.
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

/// Memory for a mesh, which belongs to the caller.
struct MeshRoom {
    std::span<std::array<float, 3>> vertices = {};  ///< world coordinates x, y, z
    std::span<std::array<std::uint32_t, 3>> triangles = {};
    std::span<std::array<float, 3>> normals = {};  ///< empty if the layout has none
};
/// Makes room for layout.vertices vertices and layout.elements triangles; what is there does not
/// matter. Called once or, for a mesh that had to be mended, twice: then the second room holds it.
using MakeRoom = std::function<MeshRoom(const MeshLayout& layout)>;

/// The surface {U = iso} of hexahedral cells at full resolution: the triangles that extract() makes
/// of a store of the volume with Cells::hexahedra and an error of 0, in another order. They face
/// smaller values; cells with a missing corner have none. (Where float32 leaves triangles without
/// area, they are mended in that other order, which may choose another one of several ways.)
///
/// Triangles come cell by cell, x fastest, then y, then z; vertices in the order in which triangles
/// first name them. The mesh is the same for any threads and memory. The volume is read once, in
/// ascending order, or where it lies if it is mapped.
///
/// Memory beside the volume and the mesh: the mesh once more while it is put together, and a few
/// planes for each thread; the latter is what `options.memory` bounds.
///
/// Throws Error{invalid_argument} for an isovalue that is not finite, a volume with one node along
/// an axis, or one that cannot lie where it says; Error{unsupported} for labels of 64 bits and for
/// a volume whose axes are not along the world's; Error{limit} where planes need more memory or
/// vertices more than 32 bits; Error{cancelled}, and what reading the volume and `make_room` throw.
/// Thread-safety: any number of calls at once, each with its own volume.
ExtractReport march_hexahedra(VolumeSource& volume, const MarchQuery& query,
                              const MakeRoom& make_room, const ExtractOptions& options = {},
                              Progress& progress = silent_progress());
/// The same into the vectors of a collector, which gets begin() and no batches.
ExtractReport march_hexahedra(VolumeSource& volume, const MarchQuery& query, MeshCollector& mesh,
                              const ExtractOptions& options = {},
                              Progress& progress = silent_progress());

/// The surface into a sink, with what can be done to a whole mesh: the same mesh as that of
/// march_hexahedra(), without its components that are not chosen, or simplified within a distance
/// or to a number of triangles. (Simplification takes edges that cost about the same in the
/// order of the mesh, which is not that of a store's: some triangles may be others than from
/// there.) What needs a store (errors, tetrahedra, boxes, closing ...) is refused by the table of
/// combinations (tools/MANUAL.md), with RemedyKind::make_store. Axes need not be along the world's.
/// The mesh is the same for any threads and memory.
///
/// `options.memory` bounds the heap, but what the sink keeps: what grows with the mesh lies in
/// temporary files. The volume is read once, in ascending order, or where it lies if it is mapped.
///
/// Throws what march_hexahedra() throws for the volume, and what extract() of a store does.
/// Thread-safety: any number of calls at once, each with its own volume and sink.
ExtractReport extract(VolumeSource& volume, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options = {}, Progress& progress = silent_progress());

/// Bytes of ExtractOptions::memory that march_hexahedra() needs at least; nothing if the volume has
/// to become a store, because march_hexahedra() would refuse it as it is.
std::optional<std::uint64_t> march_memory(VolumeSource& volume);
/// The same for extract(), which also takes volumes that are not along the world's axes; nothing if
/// the query needs a store as well: if extract() would refuse it with RemedyKind::make_store.
/// Stages may need more, as those of a store's surface do. Nothing is read.
std::optional<std::uint64_t> march_memory(VolumeSource& volume, const SurfaceQuery& query);

/// The smallest and the largest finite value; nothing if there is none. The volume is read once, in
/// ascending order, or where it lies. Throws Error{limit, cancelled}, and what reading throws.
std::optional<std::pair<double, double>> finite_range(VolumeSource& volume,
                                                      const ExtractOptions& options = {},
                                                      Progress& progress = silent_progress());

}  // namespace isonest
