#include "query/extract/stages/fan_stage.h"

#include "query/apart/split_fans.h"
#include "query/extract/stages/distance_limits.h"

namespace isonest::detail {

void FanStage::run(StageMesh& mesh, ExtractReport& /*report*/) {
    const ExtractQuery& query = setting().query;
    const PatchBox box = rounded_box(query, query.traversal.box);
    mesh.change([&](ScratchMesh& whole) {
        split_fans(whole, {box.lo, box.hi}, setting().scratch, setting().progress);
    });
}

}  // namespace isonest::detail
