// Marching cubes with exact hits.
//
// Sources: as hexahedron_cases.h; polygon_with_hits.h for nodes that lie exactly on the surface.
#include "query/march/march_hexahedron.h"

#include "query/march/hexahedron_cases.h"
#include "query/march/polygon_with_hits.h"

namespace isonest::detail {
namespace {

/// Polygon `number` of a cell, as the table has it.
void march_polygon(PartVertices& vertices, const Cube& cube, double iso, const HexahedronCase& c,
                   std::size_t number, bool cut, std::vector<CollectedTriangle>& triangles) {
    const std::size_t begin = c.first[number];
    const std::size_t end = c.first[number + 1];
    std::array<std::uint32_t, 12> v{};
    for (std::size_t i = begin; i < end; ++i) {
        v[i] = vertices.edge_of_cube(cube, c.edge[i], iso);
    }
    for (std::size_t i = begin - 2 * number; i < end - 2 * (number + 1); ++i) {
        const auto& t = c.triangle[i];
        triangles.push_back({{v[t[0]], v[t[1]], v[t[2]]}, cut});
    }
}

}  // namespace

bool march_hexahedron_without_hits(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                                   std::vector<CollectedTriangle>& triangles) {
    const HexahedronCase& c = hexahedron_cases()[cube.below];
    std::array<std::uint32_t, 12> v{};
    for (std::size_t i = 0; i < c.edges; ++i) {
        v[i] = vertices.edge_of_cube(cube, c.edge[i], iso);
    }
    for (std::size_t i = 0; i < c.triangles; ++i) {
        const auto& t = c.triangle[i];
        triangles.push_back({{v[t[0]], v[t[1]], v[t[2]]}, cut});
    }
    return c.triangles > 0;
}

bool march_hexahedron(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                      std::vector<CollectedTriangle>& triangles, unsigned nodes) {
    const HexahedronCase& c = hexahedron_cases()[cube.below];
    for (std::size_t i = 0; i < c.polygons; ++i) {
        PolygonWithHits polygon(vertices, cube, iso, c, i, nodes);
        if (polygon.has_hits()) {
            polygon.march(cut, triangles);
        } else {
            march_polygon(vertices, cube, iso, c, i, cut, triangles);
        }
    }
    return c.triangles > 0;
}

}  // namespace isonest::detail
