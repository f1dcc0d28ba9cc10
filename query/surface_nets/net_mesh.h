// The mesh of one label, assembled from the pieces of a surface net.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <span>

#include <isonest/int3.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/surface_nets/net_store.h"
#include "store/base/vectors.h"

namespace isonest::detail {

// The diagonal along which a quad of a surface net is divided into triangles.

/// The agreement of the two triangles made by a diagonal: the cosine of the angle between their
/// normals; -2 if one has no area.
inline double agreement(const std::array<float, 3>& from, const std::array<float, 3>& one,
                        const std::array<float, 3>& to, const std::array<float, 3>& other) {
    const auto side = [&](const std::array<float, 3>& p) {
        Double3 d{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            d[axis] = static_cast<double>(p[axis]) - static_cast<double>(from[axis]);
        }
        return d;
    };
    const Double3 diagonal = side(to);
    const Double3 a = cross(side(one), diagonal);
    const Double3 b = cross(diagonal, side(other));
    const double lengths = std::sqrt(dot(a, a) * dot(b, b));
    return lengths > 0 ? dot(a, b) / lengths : -2;
}

/// 0: the diagonal between the corners 0 and 2; 1: between 1 and 3. Selects the one with the larger
/// agreement; if equal, the first. Four corners in four quadrants around an edge are not all on a
/// line, so one of the two gives both triangles an area.
inline std::uint32_t flatter_diagonal(const std::array<std::array<float, 3>, 4>& corner) {
    return agreement(corner[1], corner[2], corner[3], corner[0]) >
                   agreement(corner[0], corner[1], corner[2], corner[3])
               ? 1
               : 0;
}

struct NetMesh {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t no_area = 0;  ///< triangles without area
    /// Maximum distance of a vertex from the centre of its cell, world units.
    double moved = 0;
};

/// Outputs the mesh of a label to a sink: begin(), all batches as often as the sink requests them,
/// end(). `layout`: that of prepare(), without attributes. Vertices and triangles are in the order
/// of pieces, and within a piece in the order of its cells. REQUIRES: the store is sealed. Throws
/// what the sink throws, and Error{cancelled}. Thread-safety: any number of concurrent calls.
NetMesh emit_net_mesh(const NetStore& store, std::int64_t label, MeshLayout layout, MeshSink& sink,
                      const Progress& progress);

/// Maximum heap that a call needs, bytes.
inline constexpr std::uint64_t kNetMeshHeap = std::uint64_t{12} << 20U;

// The interfaces between labels as one mesh, each once, assembled from the pieces of a surface net.

/// Outputs all vertices and quads of the net to a sink, each once, as triangles with the labels on
/// both sides: begin(), all batches as often as the sink requests them, end(). Triangles face from
/// the smaller label to the larger one, and from labels to unlabelled space, which gets the number
/// `outside`. `layout`: that of prepare(), without attributes. Vertices and triangles are in the
/// order of pieces, and within a piece in the order of its cells; called from the threads of the
/// caller's arena if the sink is concurrent. REQUIRES: the store is sealed, and its pieces have
/// sides. Throws what the sink throws, and Error{cancelled}.
NetMesh emit_net_interfaces(const NetStore& store, std::int64_t outside, MeshLayout layout,
                            MeshSink& sink, const Progress& progress);

/// Calls `each` once for every pair of labels that share an area, with the smaller one first; for a
/// label and unlabelled space with the label and kOutsideLabel. Pairs are sorted by their wanted
/// label, or by the smaller one if both are wanted. `wanted`: those of the net. REQUIRES: as above.
void each_interface(const NetStore& store, std::span<const std::int64_t> wanted,
                    const std::function<void(const SharedArea&)>& each);

}  // namespace isonest::detail
