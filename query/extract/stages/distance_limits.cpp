#include "query/extract/stages/distance_limits.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

#include "query/mesh/surface_sums.h"
#include "store/container/extent.h"

namespace isonest::detail {

double voxel_of(const ExtractQuery& query) {
    return std::min({query.spacing[0], query.spacing[1], query.spacing[2]});
}

double most_moved(const ExtractQuery& query) {
    const double longest = std::max({query.spacing[0], query.spacing[1], query.spacing[2]});
    return std::sqrt(3.0) * query.coordinate_rounding * longest;
}

double limit_of(const StagedVolume& volume, const ExtractQuery& query) {
    return distance_left(volume.name, query.stages.distance->within, most_moved(query));
}

double nested_limit_of(const StagedVolume& volume, const ExtractQuery& query) {
    // Rounding takes half a unit in the last place, mending up to four; and sheets are kept apart.
    ExtractQuery moved = query;
    moved.coordinate_rounding =
        9 * query.coordinate_rounding +
        (query.moves_apart ? kMostApart * step_apart(query.coordinate_rounding, query.least_apart)
                           : 0);
    return distance_left(volume.name, *query.nested_distance, most_moved(moved));
}

double first_budget_limit(const ExtractQuery& query) {
    constexpr double kVoxels = 0.25;
    return kVoxels * voxel_of(query);
}

WorldLattice world_lattice(const StagedVolume& volume, const ExtractQuery& query) {
    return {query.origin, query.spacing, volume.header.nodes};
}

PatchBox rounded_box(const ExtractQuery& query, const ClipBox& box) {
    PatchBox world;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto at = [&](double x) {
            return static_cast<float>(query.origin[axis] + query.spacing[axis] * x);
        };
        world.lo[axis] = at(box.lo[axis]);
        world.hi[axis] = at(box.hi[axis]);
    }
    return world;
}

PatchBox world_box(const ExtractQuery& query) {
    return rounded_box(query, query.asked_box ? *query.asked_box : query.traversal.box);
}

void report_full(const StageMesh& mesh, ExtractReport& report) {
    const ScratchMesh& vertices = mesh.vertices();
    report.distance->full_triangles = vertices.layout().elements;
    report.distance->full = measures_of(vertices.layout(), vertices.positions(), mesh.elements());
}

void refuse_budget(const StagedVolume& volume, std::uint64_t most, std::uint64_t triangles,
                   const ComponentSizes& sizes) {
    std::string problem = fmt::format(
        "{} triangles are the fewest that were found for the surface, at any distance: its parts "
        "and holes stay",
        triangles);
    std::vector<Remedy> remedies;
    if (sizes.components > 1) {
        problem += fmt::format("; the largest of its {} components has {} of them",
                               sizes.components, sizes.largest);
        if (sizes.largest <= most) {
            remedies.push_back({RemedyKind::fewer_components});
        }
    }
    throw Error(ErrorKind::limit, {volume.name}, problem, remedies);
}

bool any_distance(const StagedVolume& volume, const ExtractQuery& query) {
    return query.stages.distance->within >= diagonal_of(volume.header);
}

}  // namespace isonest::detail
