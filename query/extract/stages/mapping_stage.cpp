#include "query/extract/stages/mapping_stage.h"

#include <algorithm>

#include "query/extract/stages/distance_limits.h"
#include "query/extract/stages/stage_memory.h"
#include "query/simplify/mapping/map_mesh.h"

namespace isonest::detail {
int MappingStage::threads() const {
    ExtractOptions options = setting().options;
    options.memory -= std::min(options.memory, mapping_->heap());
    return threads_within(setting().volume, options, map_heap(),
                          "simplification within a distance");
}

void MappingStage::run(StageMesh& mesh, ExtractReport& report) {
    const auto& [volume, query, options, scratch, progress] = setting();
    const double limit = limit_of(volume, query);
    const std::optional<std::uint64_t>& most = query.stages.distance->triangles;
    report_full(mesh, report);
    MeshMapper mapper(mesh.vertices(), world_lattice(volume, query), world_box(query), scratch,
                      progress);
    mapper.map_by(*mapping_);
    const auto consume = [&mesh](std::uint64_t first, std::uint64_t count) {
        mesh.consume(first, count);
    };
    const Mapped result =
        most ? mapper.down_to(mapper.full(mesh.elements()), *most, first_budget_limit(query), limit)
             : mapper.within(mapper.full(mesh.elements(), consume), limit);
    mapping_->finish();
    const auto corners = std::make_shared<CornerFile>(mapper.corners(result));
    if (most) {
        report.within_budget = result.triangles <= *most;
        report.distance->asked = result.limit + (result.limit > 0 ? most_moved(query) : 0);
        if (!*report.within_budget && any_distance(volume, query)) {
            refuse_budget(
                volume, *most, result.triangles,
                component_sizes(mesh.vertices().layout().vertices, corners->all(), scratch));
        }
    }
    mesh.choose(corners->all(), corners);
    report.distance->bound = result.bound + most_moved(query);
}

}  // namespace isonest::detail
