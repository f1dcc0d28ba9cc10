// The stage that counts what stays open of a surface that was closed.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// REQUIRES: a closed box, and missing values, without which there is nothing to count.
class BorderStage : public Stage {
  public:
    using Stage::Stage;
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
