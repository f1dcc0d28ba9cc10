// The stage that simplifies isolines within a distance.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// REQUIRES: stages.simplifies(), of lines.
class LineStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] int threads() const override;
    /// Throws Error{limit} too: a distance that float32 does not hold.
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
