// What the surface looks like in a cube none of whose corners lies exactly on it.
//
// Source: as marching cubes (W. Lorensen, H. Cline, 1987), but by the six Kuhn tetrahedra of the
// cube, so that the triangles are those of marching tetrahedra. Derived from them when first used.
#pragma once

#include <array>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// Edges of the tetrahedra of a cube, the diagonals of its faces and of itself included. Corners of
/// a cube are numbered by bits x, y, z, seen from its all-even corner.
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

/// The number of the edge between two corners. REQUIRES: they are the ends of one.
std::uint8_t edge_between(unsigned a, unsigned b);

struct CubeCase {
    std::uint8_t leaves = 0;  ///< tetrahedra that the surface crosses
    std::uint8_t edges = 0;
    std::array<std::uint8_t, kCubeEdges> edge{};  ///< that the surface crosses
    /// Edges whose vertices are the corners; in the order of the tetrahedra (kAxisOrders).
    std::array<std::array<std::uint8_t, 3>, 12> triangle{};
    /// Where each tetrahedron's triangles begin, and after the last one their number.
    std::array<std::uint8_t, 7> first{};
};

/// By the corners below the isovalue (bits 0 to 7). `mirrored`: the cube is the mirror image, along
/// an odd number of axes, of one whose corner 0 is its low one.
using CubeCases = std::array<CubeCase, 256>;
const CubeCases& cube_cases(bool mirrored);

}  // namespace isonest::detail
