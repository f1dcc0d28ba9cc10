#include "query/extract/stages/border_stage.h"

#include "query/mesh/border_count.h"

namespace isonest::detail {

void BorderStage::run(StageMesh& mesh, ExtractReport& report) {
    report.closing->border_vertices =
        border_vertices(mesh.vertices(), mesh.elements(), setting().scratch, setting().progress);
}

}  // namespace isonest::detail
