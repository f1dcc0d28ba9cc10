// Single-threaded replacement for oneTBB's header of this name.
#pragma once

namespace tbb {

struct simple_partitioner {};

}  // namespace tbb
