#include "query/extract/stages/line_stage.h"

#include "query/extract/stages/distance_limits.h"
#include "query/extract/stages/stage_memory.h"
#include "query/simplify/lines/simplify_lines.h"

namespace isonest::detail {
namespace {

/// Of data in a plane.
int flat_axis(const Int3& nodes) {
    return nodes.x == 1 ? 0 : nodes.y == 1 ? 1 : 2;
}

}  // namespace

int LineStage::threads() const {
    return threads_within(setting().volume, setting().options, simplify_lines_heap(),
                          "simplification within a distance");
}

void LineStage::run(StageMesh& mesh, ExtractReport& report) {
    const auto& [volume, query, options, scratch, progress] = setting();
    const auto lines = std::make_shared<SimplifiedLines>(
        mesh.vertices(), mesh.elements(), flat_axis(volume.header.nodes), limit_of(volume, query),
        scratch, progress);
    mesh.choose(lines->corners(), lines);
    report.distance->full_triangles = mesh.vertices().layout().elements;
    report.distance->bound = lines->bound() + most_moved(query);
}

}  // namespace isonest::detail
