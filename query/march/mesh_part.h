// A finished part of a mesh, as the threads hand them over to be welded.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "query/march/vertex_key.h"

namespace isonest::detail {

/// Vertices in the order in which the triangles first name them.
struct MeshPart {
    static constexpr std::uint32_t kNoVertex = 0xFFFFFFFFU;

    /// A vertex (or, without one, a link between other parts' vertices) that other parts may share.
    struct Shared {
        std::uint32_t vertex = kNoVertex;
    };
    /// A name of shared element `shared`. Elements of any part with an equal name are one vertex.
    struct Name {
        VertexKey key;
        std::uint32_t shared = 0;
    };
    /// A vertex where the box cuts a triangle edge whose ends are both shared. Equal ends and plane
    /// in another part mean the same vertex.
    struct Cut {
        std::uint32_t end0 = 0;  ///< shared elements
        std::uint32_t end1 = 0;
        std::uint32_t plane = 0;
        std::uint32_t shared = 0;  ///< the element of the cut vertex itself
    };
    std::vector<Double3> positions;  ///< coordinates of the finest lattice
    /// In place of these: world coordinates, as rounded.
    std::vector<std::array<float, 3>> world = {};
    /// Vertices that are not on an edge of their own; with world coordinates all that may share
    /// their places with other ones. Ascending.
    std::vector<std::uint32_t> off_edges;
    std::vector<std::uint32_t> attributes;  ///< AttributeWords, as many per vertex as asked for
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<Shared> shared;  ///< those with a vertex in ascending order of it
    std::vector<Name> names;
    std::vector<Cut> cuts;
    /// ClipContext::cut_fans(), of a surface that may come back to a node or an edge.
    std::uint64_t cut_fans = 0;
};

}  // namespace isonest::detail
