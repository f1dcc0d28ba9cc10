#include "query/extract/stages/pipeline.h"

#include <algorithm>
#include <cmath>

#include "query/apart/keep_apart.h"
#include "query/apart/split_fans.h"
#include "query/extract/stages/simplify_stages.h"
#include "query/mesh/components.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/mend_triangles.h"
#include "query/mesh/vertex_stars.h"

namespace isonest::detail {

ApartRange within_faces(ApartRange range, const MeshPlace& place) {
    const PatchBox faces = place.faces();
    range.low_faces = faces.lo;
    range.high_faces = faces.hi;
    return range;
}

StageResult apart_result(const ApartVertices& apart, const LatticeSteps& steps) {
    return {.moved = max_in_lattice(apart.by, steps),
            .apart = ApartReport{apart.moved, apart.left}};
}

StageResult ApartStage::run(StageMesh& mesh, const StageTools& tools) {
    const PlacedVertices placed(mesh.vertices(), range_.rotation, tools.scratch);
    if (sort_by_place(placed.all()) == 0) {
        return {};
    }
    ApartVertices apart;
    mesh.change([&](ScratchMesh& whole) {
        TouchedTriangles touched(placed.all(), whole.layout().vertices, tools.scratch);
        touched.gather_among(
            whole.corners().size(), [&](std::uint64_t t) { return whole.corners()[t]; },
            tools.progress);
        ApartRange range = within_faces(range_, tools.place);
        range.lo = whole.layout().lo;
        range.hi = whole.layout().hi;
        apart = keep_apart(whole.changeable_positions(), touched.all(), placed.all(), range,
                           tools.scratch, tools.progress);
    });
    return apart_result(apart, tools.place.lattice.steps);
}

StageResult BorderStage::run(StageMesh& mesh, const StageTools& tools) {
    return {.border_vertices =
                border_vertices(mesh.vertices(), mesh.elements(), tools.scratch, tools.progress)};
}

StageResult ComponentStage::run(StageMesh& mesh, const StageTools& tools) {
    const auto kept =
        std::make_shared<KeptComponents>(mesh.vertices(), choice_, tools.scratch, tools.progress);
    if (kept->report().dropped > 0) {
        mesh.choose(kept->corners(), kept, &kept->file());
    }
    return {.components = kept->report()};
}

StageResult FanStage::run(StageMesh& mesh, const StageTools& tools) {
    mesh.change([&](ScratchMesh& whole) {
        split_fans(whole, tools.place.faces_of(box_), tools.scratch, tools.progress);
    });
    return {};
}

StageResult MendStage::run(StageMesh& mesh, const StageTools& tools) {
    const LatticeSteps& steps = tools.place.lattice.steps;
    Double3 min_step = steps.min_along();
    for (double& step : min_step) {
        step = std::fabs(step) * kMinNudge;
    }
    MendedTriangles mended;
    mesh.change([&](ScratchMesh& whole) {
        mended = mend_triangles(whole, min_step, tools.scratch, tools.progress);
    });
    StageResult result{.mended = mended.found - mended.left};
    Double3 moved = mended.moved;
    if (is_graph_ && moved[2] > 0) {
        result.value_moved = moved[2] / std::fabs(steps.along[2]);
        moved[2] = 0;
    }
    result.moved = max_in_lattice(moved, steps);
    return result;
}

Pipeline::Pipeline(const ExtractQuery& query, const StoreReader* store, const MemoryShare& memory,
                   RankTeam* team)
    : threads_(memory.threads()) {
    const int all = threads_;
    const StageChoice& asked = query.stages;
    if (query.product == Product::surface) {
        stages_.push_back(std::make_unique<FanStage>(all, query.traversal.box));
    }
    if (query.corners() == 3) {
        stages_.push_back(std::make_unique<MendStage>(all, query.product == Product::graph));
    }
    if (query.keeps_apart()) {
        stages_.push_back(std::make_unique<ApartStage>(all, query.apart_range()));
    }
    if (asked.components) {
        stages_.push_back(std::make_unique<ComponentStage>(all, *asked.components));
    }
    if (asked.simplifies()) {
        stages_.push_back(distance_stage(query.corners(), *asked.distance, memory, team));
    }
    if (asked.error) {
        stages_.push_back(std::make_unique<ErrorStage>(
            *store,
            ValueLimit{query.traversal.iso,
                       *asked.error,
                       {},
                       query.traversal.box.close.has_value(),
                       query.traversal.cells,
                       asked.error_effort},
            query.traversal.stop, query.heap(store->layout()).thread(), memory));
    }
    if (query.traversal.box.close) {
        stages_.push_back(std::make_unique<BorderStage>(all));
    }
    for (const auto& stage : stages_) {
        threads_ = std::min(threads_, stage->threads());
    }
}

std::vector<Stage*> Pipeline::with_work(const PartStore& parts, bool has_missing) const {
    std::vector<Stage*> stages;
    for (const auto& stage : stages_) {
        if (stage->has_work(parts, has_missing)) {
            stages.push_back(stage.get());
        }
    }
    return stages;
}

}  // namespace isonest::detail
