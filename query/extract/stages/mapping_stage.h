// The stage that simplifies a surface within a distance, or to a number of triangles, with the
// effort `fast`: by successive mappings alone.
#pragma once

#include <memory>

#include "query/extract/stages/stage.h"
#include "query/ranks/rank_mapping.h"

namespace isonest::detail {

/// REQUIRES: stages.simplifies(), of triangles.
class MappingStage : public Stage {
  public:
    explicit MappingStage(const StageSetting& setting)
        : Stage(setting), mapping_(mapping_by(setting.options.team, setting.options.memory)) {}
    [[nodiscard]] int threads() const override;
    /// Throws Error{limit} too, as DistanceStage does.
    void run(StageMesh& mesh, ExtractReport& report) override;

  private:
    std::unique_ptr<BlockMapping> mapping_;
};

}  // namespace isonest::detail
