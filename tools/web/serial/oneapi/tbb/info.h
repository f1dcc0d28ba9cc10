// As oneTBB's header of this name, for one thread.
#pragma once

namespace tbb::info {

inline int default_concurrency() {
    return 1;
}

}  // namespace tbb::info
