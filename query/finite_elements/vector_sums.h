// Loops over long vectors in parallel, with sums that are the same for any number of threads.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace isonest::detail {

inline constexpr std::size_t kVectorPart = 1U << 15U;

/// f(begin, end) for parts of 0 .. size, from many threads.
template <class F>
void for_parts(std::size_t size, const F& f) {
    const std::size_t parts = (size + kVectorPart - 1) / kVectorPart;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, parts), [&](const auto& r) {
        for (std::size_t i = r.begin(); i < r.end(); ++i) {
            f(i * kVectorPart, std::min(size, (i + 1) * kVectorPart));
        }
    });
}

/// The sum of term(i), which may also change what belongs to i; added in one fixed order.
template <class Term>
double sum_of(std::size_t size, const Term& term) {
    constexpr std::size_t kLanes = 8;
    std::vector<double> sums((size + kVectorPart - 1) / kVectorPart);
    for_parts(size, [&](std::size_t begin, std::size_t end) {
        std::array<double, kLanes> lane{};
        std::size_t i = begin;
        for (; i + kLanes <= end; i += kLanes) {
            for (std::size_t k = 0; k < kLanes; ++k) {
                lane[k] += term(i + k);
            }
        }
        for (; i < end; ++i) {
            lane[0] += term(i);
        }
        double sum = 0;
        for (const double part : lane) {
            sum += part;
        }
        sums[begin / kVectorPart] = sum;
    });
    double sum = 0;
    for (const double part : sums) {
        sum += part;
    }
    return sum;
}

}  // namespace isonest::detail
