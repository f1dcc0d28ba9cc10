#include "query/extract/stages/fan_stage.h"

#include "query/apart/split_fans.h"

namespace isonest::detail {

void FanStage::run(StageMesh& mesh, ExtractReport& /*report*/) {
    const ExtractQuery& query = setting().query;
    const ClipBox& box = query.traversal.box;
    BoxFaces faces;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto at = [&](double x) {
            return static_cast<float>(query.origin[axis] + query.spacing[axis] * x);
        };
        faces.low[axis] = at(box.lo[axis]);
        faces.high[axis] = at(box.hi[axis]);
    }
    mesh.change([&](ScratchMesh& whole) {
        split_fans(whole, faces, setting().scratch, setting().progress);
    });
}

}  // namespace isonest::detail
