// The stages that a query needs, in order.
#pragma once

#include <memory>
#include <vector>

#include "query/extract/stages/stage.h"

namespace isonest::detail {

class StageRow {
  public:
    /// Throws Error{limit} if there is too little memory for one of the stages.
    explicit StageRow(const StageSetting& setting);

    /// For how many threads all stages have memory.
    [[nodiscard]] int threads() const { return threads_; }
    /// Whether a mesh of these parts has to be made a whole one.
    [[nodiscard]] bool has_work(const PartStore& parts) const;
    /// REQUIRES: is called within an arena of threads(). Throws what the stages throw.
    void run(const PartStore& parts, StageMesh& mesh, ExtractReport& report) const;

  private:
    std::vector<std::unique_ptr<Stage>> stages_;
    int threads_;
};

}  // namespace isonest::detail
