// The interfaces between labels as one mesh, each once, out of the pieces of a surface net.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/surface_nets/net_mesh.h"
#include "query/surface_nets/net_store.h"

namespace isonest::detail {

/// Hands all vertices and quads of the net to a sink, each once, as triangles with the labels on
/// both sides: begin(), all batches as often as the sink asks for them, end(). Triangles face from
/// the smaller label to the larger one, and from labels to what is none, which gets the number
/// `outside`. `layout`: of prepare(), without attributes. Vertices and triangles come in the order
/// of pieces, and in each of its cells; in the threads of the arena around the call if the sink
/// says so. REQUIRES: the store is sealed, and its pieces have sides. Throws what the sink throws,
/// and Error{cancelled}.
NetMesh emit_net_interfaces(const NetStore& store, std::int64_t outside, MeshLayout layout,
                            MeshSink& sink, const Progress& progress);

/// Calls `each` with every pair of labels that share an area, once, the smaller one first; a label
/// and what is none as it and kOutsideLabel. They come by the one of the pair that is wanted, by
/// the smaller one if both are. `wanted`: those of the net. REQUIRES: as above.
void each_interface(const NetStore& store, std::span<const std::int64_t> wanted,
                    const std::function<void(const SharedArea&)>& each);

}  // namespace isonest::detail
