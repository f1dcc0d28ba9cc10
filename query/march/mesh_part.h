// A finished part of a mesh, as threads pass it on for welding.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "store/lattice/lattice.h"

namespace isonest::detail {

// A corner of an element to be marched.

struct Corner {
    Int3 node;     ///< of the lattice of LocalMesh::place(), otherwise of the finest
    double value;  ///< REQUIRES: finite
};

// Names of mesh vertices. Every brick and thread computes the same names.

/// A point of the half lattice (twice the coordinates of the finest lattice) as one number. The
/// midpoint of an edge of the nested grid identifies the edge, because every edge is the refinement
/// edge of its midpoint.
inline std::uint64_t half_lattice_key(const Int3& p) {
    constexpr auto kBase = static_cast<std::uint64_t>(2 * kMaxNodesPerAxis + 1);
    return (static_cast<std::uint64_t>(p.z) * kBase + static_cast<std::uint64_t>(p.y)) * kBase +
           static_cast<std::uint64_t>(p.x);
}

/// What kind of crossing a vertex is.
enum class VertexKind : std::uint32_t {
    /// first: midpoint of the tetrahedron edge that the surface crosses, or that is cut by a face
    /// of a closed box.
    edge,
    /// The surface passes exactly through a node; its sheets there are separate vertices. first:
    /// the node; second: midpoint of the edge opposite the node in a tetrahedron face that the
    /// sheet crosses.
    fan,
    /// Midpoint of an edge with both nodes on the surface; one for each sheet through the edge.
    /// first: midpoint of the edge; second: the third node of a face at the edge, below the
    /// isovalue.
    run,
    /// Where a face of a closed box cuts a triangle of the grid. first: midpoint of one of the
    /// triangle's edges; second: its third node, opposite to that edge.
    face,
    /// Where faces of a closed box cut hexahedra. first: midpoint of the edge, face or cell of the
    /// grid in which the vertex lies. Along an axis where the vertex lies neither at a node nor in
    /// a face of the box, it is where the surface crosses an edge.
    cell
};

struct VertexKey {
    std::uint64_t first = 0;
    std::uint64_t second = 0;
    VertexKind kind = VertexKind::edge;
    /// Bits of the faces of a closed box (2 axis + (0 low, 1 high)) in which the vertex also lies;
    /// bit 6 if it lies on the surface in a triangle.
    std::uint32_t planes = 0;
    bool operator==(const VertexKey&) const = default;
    auto operator<=>(const VertexKey&) const = default;  // NOLINT(modernize-use-nullptr)
};

struct HalfLatticeHash {
    std::size_t operator()(std::uint64_t key) const {
        const std::uint64_t h = key * 0x9E3779B97F4A7C15ULL;
        return static_cast<std::size_t>(h ^ (h >> 32U));
    }
};

struct VertexKeyHash {
    std::size_t operator()(const VertexKey& key) const {
        std::uint64_t h = key.first * 0x9E3779B97F4A7C15ULL;
        h = (h ^ (h >> 29U) ^ (key.second * 0xBF58476D1CE4E5B9ULL)) * 0x94D049BB133111EBULL;
        return static_cast<std::size_t>(h ^ (h >> 32U) ^ static_cast<std::uint64_t>(key.kind) ^
                                        (std::uint64_t{key.planes} << 8U));
    }
};

/// A part of a mesh. Vertices are in the order of their first use by triangles.
struct MeshPart {
    static constexpr std::uint32_t kNoVertex = 0xFFFFFFFFU;

    /// A vertex that other parts may share, or, without a vertex, a link between vertices of other
    /// parts.
    struct Shared {
        std::uint32_t vertex = kNoVertex;
    };
    /// A name of shared element `shared`. Elements of any parts with the same name are one vertex.
    struct Name {
        VertexKey key;
        std::uint32_t shared = 0;
    };
    /// A vertex where the box cuts a triangle edge with both ends shared. The same ends and plane
    /// in another part mean the same vertex.
    struct Cut {
        std::uint32_t end0 = 0;  ///< shared elements
        std::uint32_t end1 = 0;
        std::uint32_t plane = 0;
        std::uint32_t shared = 0;  ///< the shared element of the cut vertex itself
    };
    std::vector<Double3> positions;  ///< coordinates of the finest lattice
    /// Instead of positions: rounded world coordinates.
    std::vector<std::array<float, 3>> world = {};
    /// Vertices that are not on an edge of their own; with world coordinates, all vertices that may
    /// be at the same place as others. Ascending.
    std::vector<std::uint32_t> off_edges;
    std::vector<std::uint32_t> attributes;  ///< AttributeWords, as many per vertex as requested
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<Shared> shared;  ///< elements with a vertex, in ascending order of the vertex
    std::vector<Name> names;
    std::vector<Cut> cuts;
    /// ClipContext::cut_fans(), for a surface that may return to a node or an edge.
    std::uint64_t cut_fans = 0;
};

}  // namespace isonest::detail
