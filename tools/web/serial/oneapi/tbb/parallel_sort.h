// Single-threaded replacement for oneTBB's header of this name.
#pragma once

#include <algorithm>

namespace tbb {

template <class Iterator>
void parallel_sort(Iterator begin, Iterator end) {
    std::sort(begin, end);
}

template <class Iterator, class Precedes>
void parallel_sort(Iterator begin, Iterator end, const Precedes& precedes) {
    std::sort(begin, end, precedes);
}

}  // namespace tbb
