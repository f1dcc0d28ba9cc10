// Marching one cell of an adaptive hexahedral grid, whose faces and edges smaller cells may share.
//
// Sources: the rule on each face is that of hexahedron_cases.h. A face beside smaller cells is
// marched as their faces are, an edge beside them by halves, so that the polygons of the cells on
// both sides have the same sides; compare R. Shekhar, E. Fayyad, R. Yagel, J. F. Cornhill,
// "Octree-based decimation of marching cubes surfaces", IEEE Visualization 1996, which moves the
// finer side instead.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "query/march/finish_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

/// Node positions x + 3 y + 9 z in half edges.
struct HexCell {
    Int3 low;               ///< node of the finest lattice
    std::int64_t edge = 1;  ///< of that lattice
    /// Bit p: the node is there. Corners are; midpoints of edges and centres of faces if smaller
    /// cells have them as corners, the former wherever the latter. REQUIRES: 0 elsewhere.
    std::uint32_t nodes = 0;
    std::array<double, 27> value{};  ///< of the nodes that are there; finite
};

inline constexpr std::uint32_t kHexCorners =
    1U | 1U << 2U | 1U << 6U | 1U << 8U | 1U << 18U | 1U << 20U | 1U << 24U | 1U << 26U;

/// Adds the triangles of {value = iso} in the cell, normals to the smaller values. A node is inside
/// if its value is not below the isovalue; where it is equal, triangles of zero area may arise.
/// False if there are none. REQUIRES: place() was not called.
bool march_hex_cell(PartVertices& vertices, const HexCell& cell, double iso, bool cut,
                    std::vector<CollectedTriangle>& triangles);

}  // namespace isonest::detail
