#include "query/extract/stages/distance_stage.h"

#include "query/extract/stages/distance_limits.h"
#include "query/extract/stages/stage_memory.h"
#include "query/simplify/simplify_mesh.h"
#include "query/simplify/triangle_budget.h"

namespace isonest::detail {
namespace {

/// The part of a distance within which the full surface is simplified. Blocks of the full surface
/// are small beside the triangles of a mesh far away, whose edges at the borders of blocks then are
/// in the way. So the mesh within this part is simplified once more, within the rest of the
/// distance, in blocks of its own.
double first_limit(const ExtractQuery& query, double limit) {
    constexpr double kFar = 1.75;  // voxels, and the next one, too
    constexpr double kNear = 0.5;
    const double voxel = voxel_of(query);
    return !query.stages.distance->triangles && limit > kFar * voxel ? kNear * voxel : limit;
}

/// Within `limit`, and with no more triangles than are asked for, if the query does.
Simplified simplified(const StagedVolume& volume, const ExtractQuery& query,
                      MeshSimplifier& simplifier, const StageMesh& mesh,
                      const ScratchFolder& folder, double limit) {
    const std::optional<std::uint64_t>& most = query.stages.distance->triangles;
    if (!most) {
        return simplifier.within(simplifier.full(), limit);
    }
    const Simplified result = within_budget(simplifier, *most, first_budget_limit(query), limit);
    if (result.triangles > *most && any_distance(volume, query)) {
        refuse_budget(volume, *most, result.triangles,
                      component_sizes(mesh.vertices().layout().vertices,
                                      simplifier.corners(result).all(), folder));
    }
    return result;
}

/// What is left of the mesh; `result` is one of the simplifier's.
void choose(const MeshSimplifier& simplifier, const Simplified& result, StageMesh& mesh) {
    const auto corners = std::make_shared<CornerFile>(simplifier.corners(result));
    mesh.choose(corners->all(), corners);
}

}  // namespace

int distance_stage_threads(const StagedVolume& volume, const ExtractOptions& options) {
    return threads_within(volume, options, simplify_heap(), "simplification within a distance");
}

int DistanceStage::threads() const {
    return distance_stage_threads(setting().volume, setting().options);
}

void DistanceStage::run(StageMesh& mesh, ExtractReport& report) {
    const auto& [volume, query, options, scratch, progress] = setting();
    const double limit = limit_of(volume, query);
    const double first = first_limit(query, limit);
    report_full(mesh, report);
    {
        MeshSimplifier simplifier(mesh.growing(), mesh.elements(), world_lattice(volume, query),
                                  world_box(query), scratch, progress);
        const Simplified result = simplified(volume, query, simplifier, mesh, scratch, first);
        choose(simplifier, result, mesh);
        report.distance->bound = result.bound + most_moved(query);
        if (const auto& most = query.stages.distance->triangles) {
            report.within_budget = result.triangles <= *most;
            report.distance->asked = result.limit + (result.limit > 0 ? most_moved(query) : 0);
        }
    }
    if (first < limit) {
        simplify_far_mesh(mesh, report);
    }
}

/// Once more, within the rest of the distance.
void DistanceStage::simplify_far_mesh(StageMesh& mesh, ExtractReport& report) const {
    const auto& [volume, query, options, scratch, progress] = setting();
    auto near = std::make_shared<ScratchMesh>(scratch);
    emit_elements(mesh.vertices(), mesh.elements(), scratch, *near, progress);
    mesh.replace(near);
    MeshSimplifier simplifier(*near, near->corners(), world_lattice(volume, query),
                              world_box(query), scratch, progress);
    const Simplified result = simplifier.within(
        simplifier.full(), limit_of(volume, query) + most_moved(query) - report.distance->bound);
    choose(simplifier, result, mesh);
    report.distance->bound += result.bound;
}

}  // namespace isonest::detail
