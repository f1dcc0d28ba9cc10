// What the work on one of many labels says of its progress.
#pragma once

#include <isonest/progress.h>

namespace isonest::detail {

/// It goes to nobody; that the user stops comes through.
class LabelProgress : public Progress {
  public:
    explicit LabelProgress(const Progress& whole) : whole_(whole) {}
    [[nodiscard]] bool cancelled() const override { return whole_.cancelled(); }

  private:
    const Progress& whole_;
};

}  // namespace isonest::detail
