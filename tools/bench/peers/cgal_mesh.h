// Reads a PLY file as a CGAL mesh, for the programs that judge or simplify meshes with CGAL.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Surface_mesh.h>

#include "tools/bench/meshes/ply_mesh.h"

namespace bench {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;

/// The mesh in a PLY file, made manifold: a vertex at which several fans of triangles meet is
/// duplicated, one per fan, and so are the ends of an edge with more than two triangles. Triangles
/// with collinear corners have no plane, which CGAL's algorithms need; they are left out, and
/// counted in `flat`. Throws std::runtime_error if the file cannot be read or no triangle is left.
inline SurfaceMesh read_surface_mesh(const std::string& path, std::size_t& flat) {
    const Mesh read = read_ply(path);
    std::vector<Kernel::Point_3> points;
    points.reserve(read.points.size());
    for (const Point& p : read.points) {
        points.emplace_back(p[0], p[1], p[2]);
    }
    std::vector<std::vector<std::size_t>> triangles;
    triangles.reserve(read.triangles.size());
    for (const Triangle& t : read.triangles) {
        if (!CGAL::collinear(points[t[0]], points[t[1]], points[t[2]])) {
            triangles.push_back({t[0], t[1], t[2]});
        }
    }
    flat = read.triangles.size() - triangles.size();
    if (triangles.empty()) {
        throw std::runtime_error(path + ": no triangle");
    }
    namespace processing = CGAL::Polygon_mesh_processing;
    processing::orient_polygon_soup(points, triangles);
    SurfaceMesh mesh;
    processing::polygon_soup_to_polygon_mesh(points, triangles, mesh);
    return mesh;
}

}  // namespace bench
