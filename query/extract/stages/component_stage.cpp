#include "query/extract/stages/component_stage.h"

#include "query/mesh/components.h"

namespace isonest::detail {

void ComponentStage::run(StageMesh& mesh, ExtractReport& report) {
    const auto kept = std::make_shared<KeptComponents>(
        mesh.vertices(), *setting().query.stages.components, setting().scratch, setting().progress);
    mesh.choose(kept->corners(), kept);
    report.components = ComponentReport{kept->components(), kept->dropped(),
                                        kept->dropped_elements(), kept->largest_dropped()};
    report.scratch_bytes += kept->scratch_bytes();
}

}  // namespace isonest::detail
