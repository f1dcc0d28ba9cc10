// The stage that simplifies a surface within a distance, or to a number of triangles, with the
// effort `best`.
#pragma once

#include "query/extract/stages/stage.h"

namespace isonest::detail {

/// For how many threads a simplification within a distance has memory. Throws Error{limit} if there
/// is for none.
int distance_stage_threads(const StagedVolume& volume, const ExtractOptions& options);

/// REQUIRES: stages.simplifies(), of triangles.
class DistanceStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] int threads() const override;
    /// Throws Error{limit} too: a distance that float32 does not hold, a number of triangles that
    /// no distance gives.
    void run(StageMesh& mesh, ExtractReport& report) override;

  private:
    void simplify_far_mesh(StageMesh& mesh, ExtractReport& report) const;
};

}  // namespace isonest::detail
