#include "query/extract/stages/mend_stage.h"

#include <algorithm>
#include <cmath>

#include "query/mesh/mend_triangles.h"

namespace isonest::detail {

void MendStage::run(StageMesh& mesh, ExtractReport& report) {
    ExtractQuery& query = setting().query;
    Double3 least_step{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        least_step[axis] = std::fabs(query.spacing[axis]) * kLeastNudge;
    }
    MendedTriangles mended;
    mesh.change([&](ScratchMesh& whole) {
        mended = mend_triangles(whole, least_step, setting().scratch, setting().progress);
    });
    report.mending.mended = mended.found - mended.left;
    double moved = 0;  // in distances between nodes
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double by = mended.moved[axis] / std::fabs(query.spacing[axis]);
        if (mended.moved[axis] > 0 && axis == 2 && query.product == Product::graph) {
            report.value_rounding += by;
        } else if (mended.moved[axis] > 0) {
            moved = std::max(moved, by);
        }
    }
    query.coordinate_rounding += moved;
    report.coordinate_rounding += moved;
}

}  // namespace isonest::detail
