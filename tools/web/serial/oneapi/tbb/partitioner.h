// As oneTBB's header of this name, for one thread.
#pragma once

namespace tbb {

struct simple_partitioner {};

}  // namespace tbb
