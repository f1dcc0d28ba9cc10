#include "query/extract/stages/stage_row.h"

#include <algorithm>

#include "query/extract/stages/apart_stage.h"
#include "query/extract/stages/border_stage.h"
#include "query/extract/stages/component_stage.h"
#include "query/extract/stages/distance_stage.h"
#include "query/extract/stages/error_stage.h"
#include "query/extract/stages/fan_stage.h"
#include "query/extract/stages/line_stage.h"
#include "query/extract/stages/mapping_stage.h"
#include "query/extract/stages/mend_stage.h"

namespace isonest::detail {
namespace {

/// REQUIRES: stages.simplifies().
std::unique_ptr<Stage> simplification(const StageSetting& setting) {
    if (setting.query.corners() == 2) {
        return std::make_unique<LineStage>(setting);
    }
    if (setting.query.stages.distance->effort == Effort::fast) {
        return std::make_unique<MappingStage>(setting);
    }
    return std::make_unique<DistanceStage>(setting);
}

}  // namespace

StageRow::StageRow(const StageSetting& setting)
    : threads_(Workers::count_of(setting.options.threads)) {
    const StageChoice& asked = setting.query.stages;
    if (setting.query.product == Product::surface) {
        stages_.push_back(std::make_unique<FanStage>(setting));
    }
    if (setting.query.corners() == 3) {
        stages_.push_back(std::make_unique<MendStage>(setting));
    }
    if (setting.query.keeps_apart()) {
        stages_.push_back(std::make_unique<ApartStage>(setting));
    }
    if (asked.components) {
        stages_.push_back(std::make_unique<ComponentStage>(setting));
    }
    if (asked.simplifies()) {
        stages_.push_back(simplification(setting));
    }
    if (asked.error) {
        stages_.push_back(std::make_unique<ErrorStage>(setting));
    }
    if (setting.query.traversal.box.close && setting.volume.store != nullptr &&
        setting.volume.store->has_missing()) {
        stages_.push_back(std::make_unique<BorderStage>(setting));
    }
    for (const auto& stage : stages_) {
        threads_ = std::min(threads_, stage->threads());
    }
}

std::vector<Stage*> StageRow::with_work(const PartStore& parts) const {
    std::vector<Stage*> stages;
    for (const auto& stage : stages_) {
        if (stage->has_work(parts)) {
            stages.push_back(stage.get());
        }
    }
    return stages;
}

}  // namespace isonest::detail
