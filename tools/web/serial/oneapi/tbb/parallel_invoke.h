// Single-threaded replacement for oneTBB's header of this name.
#pragma once

namespace tbb {

template <class First, class Second>
void parallel_invoke(const First& first, const Second& second) {
    first();
    second();
}

}  // namespace tbb
