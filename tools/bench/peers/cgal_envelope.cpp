// CGAL's edge collapse (cost and placement of P. Lindstrom and G. Turk, "Fast and memory efficient
// polygonal simplification", IEEE Visualization 1998) that leaves no triangle outside a polyhedral
// envelope of the input (B. Wang, T. Schneider, Y. Hu, M. Attene, D. Panozzo, "Exact and efficient
// polyhedral envelope containment check", ACM Transactions on Graphics 39(4), 2020).
//
// usage: isonest_cgal_envelope IN.ply ENVELOPE OUT.ply
//
// Collapses edges until no collapse stays within ENVELOPE, in the mesh's unit. The envelope bounds
// the distance from the output to the input, not the opposite one. Prints JSON; the seconds are the
// processor time of the collapse alone.
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_normal_change_filter.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Count_stop_predicate.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_cost.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_placement.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Polyhedral_envelope_filter.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>

#include <ctime>

#include "tools/bench/meshes/ply_write.h"
#include "tools/bench/peers/cgal_mesh.h"

using namespace bench;
namespace collapse = CGAL::Surface_mesh_simplification;

namespace {

Mesh plain(const SurfaceMesh& mesh) {
    Mesh out;
    std::vector<std::uint32_t> number(mesh.num_vertices());
    for (const auto v : mesh.vertices()) {
        number[v.idx()] = static_cast<std::uint32_t>(out.points.size());
        const auto& p = mesh.point(v);
        out.points.push_back({p.x(), p.y(), p.z()});
    }
    for (const auto f : mesh.faces()) {
        Triangle t{};
        std::size_t i = 0;
        for (const auto v : mesh.vertices_around_face(mesh.halfedge(f))) {
            t[i++] = number[v.idx()];
        }
        out.triangles.push_back(t);
    }
    return out;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        if (argc != 4) {
            throw std::runtime_error("usage: isonest_cgal_envelope IN.ply ENVELOPE OUT.ply");
        }
        using Filter =
            collapse::Polyhedral_envelope_filter<Kernel, collapse::Bounded_normal_change_filter<>>;
        std::size_t flat = 0;
        SurfaceMesh mesh = read_surface_mesh(argv[1], flat);
        const std::size_t before = mesh.number_of_faces();
        const std::clock_t start = std::clock();
        collapse::edge_collapse(
            mesh, collapse::Count_stop_predicate<SurfaceMesh>(0),
            CGAL::parameters::get_cost(collapse::LindstromTurk_cost<SurfaceMesh>())
                .get_placement(collapse::LindstromTurk_placement<SurfaceMesh>())
                .filter(Filter(std::stod(argv[2]))));
        const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
        mesh.collect_garbage();
        write_ply(argv[3], plain(mesh));
        std::printf(
            "{\"full_triangles\": %zu, \"flat\": %zu, \"triangles\": %zu, \"seconds\": %.3f}\n",
            before, flat, std::size_t{mesh.number_of_faces()}, seconds);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "isonest_cgal_envelope: %s\n", error.what());
        return 1;
    }
}
