// As oneTBB's header of this name, for one thread.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/partitioner.h>

#include <type_traits>

namespace tbb {

template <class Index, class Body>
requires std::is_integral_v<Index>
void parallel_for(Index begin, Index end, const Body& body) {
    for (Index i = begin; i < end; ++i) {
        body(i);
    }
}

/// The range is not split: `body` is called once, if there is anything in it.
template <class Range, class Body>
void parallel_for(const Range& range, const Body& body) {
    if (range.begin() < range.end()) {
        body(range);
    }
}

/// Also where the caller asked for ranges of its grain: what it does may not depend on them.
template <class Range, class Body>
void parallel_for(const Range& range, const Body& body, const simple_partitioner& /*how*/) {
    parallel_for(range, body);
}

template <class Index, class Body>
requires std::is_integral_v<Index>
void parallel_for(Index begin, Index end, const Body& body, const simple_partitioner& /*how*/) {
    parallel_for(begin, end, body);
}

}  // namespace tbb
