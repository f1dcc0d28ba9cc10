// Computes results in parallel and uses them one at a time, in order.
#pragma once

#include <oneapi/tbb/parallel_pipeline.h>

#include <cstdint>
#include <vector>

namespace isonest::detail {

/// Calls compute(i) for i = 0 ... count - 1 in parallel, and use(i, result) for each result, one at
/// a time and in ascending order. So the output does not depend on the threads, and no two of them
/// wait for the same file. At most `tokens` results are alive. Throws what the first failing call
/// throws.
template <class Compute, class Use>
void in_order(std::int64_t count, int tokens, const Compute& compute, const Use& use) {
    using Result = decltype(compute(std::int64_t{0}));
    // The results are stored here and only their numbers are tokens, because tokens under way are
    // not destroyed when something fails. The last stage is in order, so at most the last `tokens`
    // are alive.
    std::vector<Result> results(static_cast<std::size_t>(tokens));
    const auto result_of = [&](std::int64_t i) -> Result& {
        return results[static_cast<std::size_t>(i) % results.size()];
    };
    std::int64_t next = 0;
    const auto number = tbb::make_filter<void, std::int64_t>(
        tbb::filter_mode::serial_in_order, [&](tbb::flow_control& control) -> std::int64_t {
            if (next == count) {
                control.stop();
                return 0;
            }
            return next++;
        });
    const auto make = tbb::make_filter<std::int64_t, std::int64_t>(tbb::filter_mode::parallel,
                                                                   [&](std::int64_t i) {
                                                                       result_of(i) = compute(i);
                                                                       return i;
                                                                   });
    const auto hand_over = tbb::make_filter<std::int64_t, void>(tbb::filter_mode::serial_in_order,
                                                                [&](std::int64_t i) {
                                                                    use(i, result_of(i));
                                                                    result_of(i) = {};
                                                                });
    tbb::parallel_pipeline(results.size(), number & make & hand_over);
}

}  // namespace isonest::detail
