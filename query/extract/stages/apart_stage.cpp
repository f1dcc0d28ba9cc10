#include "query/extract/stages/apart_stage.h"

#include <cmath>

#include "query/apart/placed_vertices.h"
#include "query/apart/touched_triangles.h"
#include "query/extract/stages/distance_limits.h"
#include "query/mesh/coordinate_rounding.h"

namespace isonest::detail {

ApartRange apart_range(const ExtractQuery& query) {
    ApartRange range;
    const PatchBox box = world_box(query);
    range.moves = query.moves_apart;
    range.turn = query.turn;
    range.low_faces = box.lo;
    range.high_faces = box.hi;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        range.least_step[axis] = std::fabs(query.spacing[axis]) * query.least_apart;
    }
    return range;
}

void count_apart(const ApartVertices& apart, ExtractQuery& query, ExtractReport& report) {
    report.apart = {apart.moved, apart.left};
    const double moved = most_in_lattice(apart.by, query.spacing);
    query.coordinate_rounding += moved;
    report.coordinate_rounding += moved;
}

void ApartStage::run(StageMesh& mesh, ExtractReport& report) {
    const ScratchFolder& folder = setting().scratch;
    const PlacedVertices placed(mesh.vertices(), setting().query.turn, folder);
    if (sort_by_place(placed.all()) == 0) {
        return;
    }
    mesh.change([&](ScratchMesh& whole) {
        TouchedTriangles touched(placed.all(), whole.layout().vertices, folder);
        touched.gather_among(
            whole.corners().size(), [&](std::uint64_t t) { return whole.corners()[t]; },
            setting().progress);
        ApartRange range = apart_range(setting().query);
        range.lo = whole.layout().lo;
        range.hi = whole.layout().hi;
        count_apart(keep_apart(whole.changeable_positions(), touched.all(), placed.all(), range,
                               folder, setting().progress),
                    setting().query, report);
    });
}

}  // namespace isonest::detail
