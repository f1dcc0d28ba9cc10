// The mesh of one label, out of the pieces of a surface net.
#pragma once

#include <cstdint>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/surface_nets/net_store.h"

namespace isonest::detail {

struct NetMesh {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t no_area = 0;  ///< of the triangles
    /// The furthest that a vertex is from the centre of its cell, world units.
    double moved = 0;
};

/// Hands the mesh of a label to a sink: begin(), all batches as often as the sink asks for them,
/// end(). `layout`: of prepare(), without attributes. Vertices and triangles come in the order of
/// pieces, and in each of its cells. REQUIRES: the store is sealed. Throws what the sink throws,
/// and Error{cancelled}. Thread-safety: any number of calls at once.
NetMesh emit_net_mesh(const NetStore& store, std::int64_t label, MeshLayout layout, MeshSink& sink,
                      const Progress& progress);

/// Bytes of heap that a call needs, at most.
inline constexpr std::uint64_t kNetMeshHeap = std::uint64_t{12} << 20U;

}  // namespace isonest::detail
