// Single-threaded replacement for oneTBB's header of this name.
#pragma once

namespace tbb::info {

inline int default_concurrency() {
    return 1;
}

}  // namespace tbb::info
