// The distance of two meshes by CGAL's bounded_error_symmetric_Hausdorff_distance (after M. Tang,
// M. Lee, Y. J. Kim, "Interactive Hausdorff distance computation for general polygonal models", ACM
// Transactions on Graphics 28(3), 2009), which shares no code with isonest_mesh_distance except for
// reading files.
//
// usage: isonest_cgal_distance A.ply B.ply ERROR_BOUND
//
// "distance" is at most ERROR_BOUND away from the largest distance of any point of one mesh to the
// other mesh, in either direction, in the meshes' unit. Prints JSON; the seconds are processor
// time.

// distance.h of CGAL 5.5 needs the kernel's declarations, but does not include them.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/distance.h>

#include <ctime>

#include "tools/bench/peers/cgal_mesh.h"

using namespace bench;

int main(int argc, char** argv) {
    try {
        if (argc != 4) {
            throw std::runtime_error("usage: isonest_cgal_distance A.ply B.ply ERROR_BOUND");
        }
        std::array<std::size_t, 2> flat{};
        const SurfaceMesh a = read_surface_mesh(argv[1], flat[0]);
        const SurfaceMesh b = read_surface_mesh(argv[2], flat[1]);
        const std::clock_t start = std::clock();
        const double distance =
            CGAL::Polygon_mesh_processing::bounded_error_symmetric_Hausdorff_distance<
                CGAL::Sequential_tag>(a, b, std::stod(argv[3]));
        const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
        std::printf(
            "{\"triangles\": [%zu, %zu], \"flat\": [%zu, %zu], \"distance\": %.9g, "
            "\"seconds\": %.3f}\n",
            std::size_t{a.number_of_faces()}, std::size_t{b.number_of_faces()}, flat[0], flat[1],
            distance, seconds);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "isonest_cgal_distance: %s\n", error.what());
        return 1;
    }
}
