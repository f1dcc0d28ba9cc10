// The stage that mends triangles without area, once fans are split and before anything else is done
// to a whole mesh.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// Of triangles (query/mesh/mend_triangles.h). What moves did to coordinates is counted as their
/// rounding, in the report and in the query.
class MendStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] bool has_work(const PartStore& parts) const override {
        return parts.zero_area_triangles() > 0;
    }
    void run(StageMesh& mesh, ExtractReport& report) override;
};

}  // namespace isonest::detail
