// Single-threaded replacement for oneTBB's header of this name.
#pragma once

#include <cstddef>

namespace tbb {

class global_control {
  public:
    enum parameter { max_allowed_parallelism };
    global_control(parameter /*what*/, std::size_t /*value*/) {}
};

}  // namespace tbb
