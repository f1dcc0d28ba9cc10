// Cases of the surface in a tetrahedron, in a cube of six tetrahedra, and in a hexahedral cell.
#pragma once

#include <array>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

// How the surface crosses a tetrahedron.

struct Crossing {
    int below = 0;  ///< number of corners below the isovalue
    /// First the corner that is alone on its side, or the two that are not below.
    std::array<std::uint8_t, 4> order{};
    bool flip = false;  ///< the order reverses the tetrahedron's orientation
};

/// Indexed by the corners that are below (bits 0 to 3).
constexpr std::array<Crossing, 16> make_crossings() {
    std::array<Crossing, 16> crossings{};
    for (unsigned mask = 0; mask < crossings.size(); ++mask) {
        Crossing& c = crossings[mask];
        for (unsigned i = 0; i < 4; ++i) {
            c.below += static_cast<int>((mask >> i) & 1U);
        }
        const unsigned first = c.below == 1 ? 1 : 0;
        std::size_t n = 0;
        for (const unsigned side : {first, 1 - first}) {
            for (std::uint8_t i = 0; i < 4; ++i) {
                if (((mask >> i) & 1U) == side) {
                    c.order[n++] = i;
                }
            }
        }
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t j = i + 1; j < 4; ++j) {
                c.flip = c.flip != (c.order[i] > c.order[j]);
            }
        }
    }
    return crossings;
}
inline constexpr std::array<Crossing, 16> kCrossings = make_crossings();

// The surface in a cube with no corner exactly on it.
//
// Source: like marching cubes (W. Lorensen, H. Cline, 1987), but derived from the six Kuhn
// tetrahedra of the cube, so that the triangles are those of marching tetrahedra. Computed at first
// use.

/// Edges of the tetrahedra of a cube, including the diagonals of its faces and of the cube. Corners
/// of a cube are numbered by bits x, y, z, seen from its all-even corner.
inline constexpr std::size_t kCubeEdges = 19;
struct CubeEdge {
    std::uint8_t low = 0;  ///< corner
    std::uint8_t high = 0;
    std::uint8_t midpoint = 0;  ///< node position (x + 3 y + 9 z) in half edges, seen from corner 0
};
constexpr std::array<CubeEdge, kCubeEdges> make_cube_edges() {
    std::array<CubeEdge, kCubeEdges> edges{};
    std::size_t next = 0;
    for (std::int64_t i = 0; i < 27; ++i) {
        const Int3 p = Int3{3, 3, 3}.unlinear(i);
        if (((p.x | p.y | p.z) & 1) == 0) {
            continue;
        }
        const auto corner = [](std::int64_t x, std::int64_t y, std::int64_t z) {
            return static_cast<std::uint8_t>(x + 2 * y + 4 * z);
        };
        edges[next++] = {corner(p.x / 2, p.y / 2, p.z / 2),
                         corner((p.x + 1) / 2, (p.y + 1) / 2, (p.z + 1) / 2),
                         static_cast<std::uint8_t>(i)};
    }
    return edges;
}
inline constexpr std::array<CubeEdge, kCubeEdges> kCubeEdge = make_cube_edges();

/// The number of the edge between two corners. REQUIRES: there is such an edge.
std::uint8_t edge_between(unsigned a, unsigned b);

struct CubeCase {
    std::uint8_t leaves = 0;  ///< number of tetrahedra that the surface crosses
    std::uint8_t edges = 0;
    std::array<std::uint8_t, kCubeEdges> edge{};  ///< edges that the surface crosses
    /// Triangles; corners are edges (the vertex is on the edge). In the order of the tetrahedra
    /// (kAxisOrders).
    std::array<std::array<std::uint8_t, 3>, 12> triangle{};
    /// Index of the first triangle of each tetrahedron, followed by the number of triangles.
    std::array<std::uint8_t, 7> first{};
};

/// Indexed by the corners below the isovalue (bits 0 to 7). `mirrored`: the cube is mirrored along
/// an odd number of axes, relative to one whose corner 0 is its low corner.
using CubeCases = std::array<CubeCase, 256>;
const CubeCases& cube_cases(bool mirrored);

// The surface in a hexahedral cell, a cube marched as a whole.
//
// Sources: W. Lorensen, H. Cline, "Marching cubes", SIGGRAPH 1987. On ambiguous faces (corners on
// alternate sides) the surface cuts off the two corners that are below. This rule uses only the
// signs on the face, as in C. Montani, R. Scateni, R. Scopigno, "A modified look-up table for
// implicit disambiguation of marching cubes", The Visual Computer 10 (1994), so both cells at the
// face agree. Computed from the rule at first use.

/// The surface in a cell is a set of polygons. Their corners are on cube edges that the surface
/// crosses (one corner each), their sides in the cube's faces. Faces are numbered 2 axis + (0 low,
/// 1 high).
struct HexahedronCase {
    std::uint8_t edges = 0;  ///< number of edges that the surface crosses
    /// Positions in kCubeEdge, seen from the low corner. Polygon by polygon, each counterclockwise
    /// seen from the smaller values.
    std::array<std::uint8_t, 12> edge{};
    /// The face of the polygon side that starts at this corner.
    std::array<std::uint8_t, 12> face{};
    std::uint8_t polygons = 0;
    std::array<std::uint8_t, 5> first{};  ///< first corner of each polygon, followed by `edges`
    std::uint8_t triangles = 0;
    /// Corners as positions in `edge`. Only sides of polygons lie in faces of the cell, no other
    /// sides of triangles.
    std::array<std::array<std::uint8_t, 3>, 10> triangle{};
};

/// Indexed by the corners below the isovalue (bits 0 to 7), seen from the low corner.
using HexahedronCases = std::array<HexahedronCase, 256>;
const HexahedronCases& hexahedron_cases();

/// A face's corners, counterclockwise seen from outside.
std::array<unsigned, 4> corners_of_face(unsigned face);

/// Bits of the cube's faces in which a corner, or the edge between two corners, lies.
constexpr unsigned faces_at(unsigned corner) {
    unsigned faces = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        faces |= 1U << (2 * axis + (corner >> axis & 1U));
    }
    return faces;
}
constexpr unsigned faces_at(const CubeEdge& edge) {
    return faces_at(edge.low) & faces_at(edge.high);
}

}  // namespace isonest::detail
