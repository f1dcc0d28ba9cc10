// The stage that gives each fan a vertex of its own where the box cut a sheet into several, before
// anything else is done to a whole mesh.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// Of surfaces (query/apart/split_fans.h).
class FanStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] bool has_work(const PartStore& parts) const override {
        return parts.cut_fans() > 0;
    }
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
