// The surface in a slab of a volume, before slabs are joined.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "query/march/vertex_key.h"

namespace isonest::detail {

/// Layers of cells: those between the planes `begin` and `end` of nodes, begin < end.
struct Slab {
    std::int64_t begin = 0;
    std::int64_t end = 0;
};

/// How much of a surface a slab is likely to hold: room is made for as much.
struct SlabEstimate {
    std::size_t vertices = 0;
    std::size_t triangles = 0;
};

struct MarchedSlab {
    using Point = std::array<float, 3>;
    /// A vertex on an edge of the lattice that lies in a plane.
    struct OnPlane {
        std::uint64_t edge;  ///< numbers the plane's edges
        std::uint32_t vertex;
    };
    /// A vertex with a name; the next slab may have one of that name as well. Of kind fan or run,
    /// but in `shared`.
    struct Named {
        VertexKey key;
        std::uint32_t vertex;
        bool used;  ///< by a triangle; else it only says which vertices are the same
    };

    std::vector<Point> positions;  ///< of vertices, world coordinates; some are in no triangle
    /// Of vertices that may share their places with other ones, ascending.
    std::vector<std::uint32_t> not_alone;
    std::vector<Point> normals;  ///< the same, or empty if not asked for
    /// Cell by cell, x fastest, then y, then z.
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::array<std::vector<OnPlane>, 2> on_plane;  ///< first and last, ascending
    std::array<std::vector<Named>, 2> named;       ///< the same
    /// Of a part of a slab in place of these: all that other parts and slabs may have as well.
    std::vector<Named> shared;
    std::uint64_t cells = 0;  ///< that hold triangles
};

}  // namespace isonest::detail
