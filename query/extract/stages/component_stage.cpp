#include "query/extract/stages/component_stage.h"

#include "query/mesh/components.h"

namespace isonest::detail {

void ComponentStage::run(StageMesh& mesh, ExtractReport& report) {
    const auto kept = std::make_shared<KeptComponents>(
        mesh.vertices(), *setting().query.stages.components, setting().scratch, setting().progress);
    if (kept->dropped() > 0) {
        mesh.choose(kept->corners(), kept, &kept->file());
    }
    report.components = ComponentReport{kept->components(), kept->dropped(),
                                        kept->dropped_elements(), kept->largest_dropped()};
}

}  // namespace isonest::detail
