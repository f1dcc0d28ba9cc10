#include "query/extract/mend_mesh.h"

#include <algorithm>
#include <cmath>

#include "query/mesh/mend_triangles.h"

namespace isonest::detail {
namespace {

/// Of the distance between nodes: no more than float32 rounds coordinates in volumes of 16 nodes
/// along an axis.
constexpr double kLeastStep = 0x1p-20;

}  // namespace

void mend_mesh(ExtractQuery& query, ScratchMesh& mesh, const std::filesystem::path& scratch,
               ExtractReport& report, Progress& progress) {
    Double3 least_step{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        least_step[axis] = std::fabs(query.spacing[axis]) * kLeastStep;
    }
    const MendedTriangles mended = mend_triangles(mesh, least_step, scratch, progress);
    report.mended_triangles = mended.found - mended.left;
    report.scratch_bytes += mended.scratch_bytes;
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
