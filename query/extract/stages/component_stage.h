// The stage that drops components.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// REQUIRES: stages.components. All vertices of the mesh are named by its elements.
class ComponentStage : public Stage {
  public:
    using Stage::Stage;
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
