// As oneTBB's header of this name, for one thread.
#pragma once

#include <cstddef>

namespace tbb {

class global_control {
  public:
    enum parameter { max_allowed_parallelism };
    global_control(parameter /*what*/, std::size_t /*value*/) {}
};

}  // namespace tbb
