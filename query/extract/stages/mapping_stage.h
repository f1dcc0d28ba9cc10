// The stage that simplifies a surface within a distance, or to a number of triangles, with the
// effort `fast`: by successive mappings alone.
#pragma once

#include "query/extract/stages/stage.h"
#include "query/simplify/mapping/block_mapping.h"

namespace isonest::detail {

/// REQUIRES: stages.simplifies(), of triangles.
class MappingStage : public Stage {
  public:
    /// `mapping`: who maps the blocks; has to stay.
    MappingStage(const StageSetting& setting, BlockMapping& mapping)
        : Stage(setting), mapping_(mapping) {}
    [[nodiscard]] int threads() const override;
    /// Throws Error{limit} too, as DistanceStage does.
    void run(StageMesh& mesh, ExtractReport& report) override;

  private:
    BlockMapping& mapping_;
};

}  // namespace isonest::detail
