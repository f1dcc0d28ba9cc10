// Single-threaded replacement for oneTBB's header of this name.
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

/// The range is not split: `body` is called once, unless the range is empty.
template <class Range, class Body>
void parallel_for(const Range& range, const Body& body) {
    if (range.begin() < range.end()) {
        body(range);
    }
}

/// Also does not split the range: results may not depend on the grain size.
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
