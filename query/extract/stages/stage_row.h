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
    /// Those that have work with a mesh of these parts; if there are none, it need not be made a
    /// whole one. They live as long as the row.
    [[nodiscard]] std::vector<Stage*> with_work(const PartStore& parts) const;

  private:
    std::vector<std::unique_ptr<Stage>> stages_;
    int threads_;
};

}  // namespace isonest::detail
