// The stage that simplifies a surface within a distance, or to a number of triangles, with the
// effort `fast`: by successive mappings alone.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// REQUIRES: stages.simplifies(), of triangles.
class MappingStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] int threads() const override;
    /// Throws Error{limit} too, as DistanceStage does.
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
