// Names for mesh vertices that every brick and thread computes alike.
#pragma once

#include <cstdint>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// A point of the half lattice (twice the finest lattice's coordinates) as one number. The midpoint
/// of an edge of the nested grid names the edge, because every edge is the refinement edge of its
/// midpoint.
inline std::uint64_t half_lattice_key(const Int3& p) {
    constexpr auto kBase = static_cast<std::uint64_t>(2 * kMaxNodesPerAxis + 1);
    return (static_cast<std::uint64_t>(p.z) * kBase + static_cast<std::uint64_t>(p.y)) * kBase +
           static_cast<std::uint64_t>(p.x);
}

/// What a vertex is the crossing of.
enum class VertexKind : std::uint32_t {
    /// first: midpoint of the tetrahedron edge that the surface crosses, or that a face of a closed
    /// box cuts.
    edge,
    /// The surface passes exactly through a node; its sheets there are separate vertices. first:
    /// the node; second: midpoint of the edge opposite to it in a tetrahedron face that the sheet
    /// crosses.
    fan,
    /// Midpoint of an edge whose two nodes both lie on the surface; one for each sheet through the
    /// edge. first: midpoint of the edge; second: the third node of a face at the edge, below the
    /// isovalue.
    run,
    /// Where a face of a closed box cuts a triangle of the grid. first: midpoint of one of the
    /// triangle's edges; second: its third node, opposite to that edge.
    face,
    /// Where the faces of a closed box cut hexahedra. first: midpoint of the edge, the face or the
    /// cell of the grid in which the vertex lies. Along an axis that has it neither in a node nor
    /// in a face of the box it is where the surface crosses an edge.
    cell
};

struct VertexKey {
    std::uint64_t first = 0;
    std::uint64_t second = 0;
    VertexKind kind = VertexKind::edge;
    /// Bits of the faces of a closed box (2 axis + (0 low, 1 high)) in which the vertex lies as
    /// well, and bit 6 if it lies on the surface in a triangle.
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

}  // namespace isonest::detail
