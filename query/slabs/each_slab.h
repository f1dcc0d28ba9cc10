// Slabs of a volume, read in order and worked on in parallel.
#pragma once

#include <oneapi/tbb/parallel_pipeline.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include <isonest/progress.h>

#include "query/slabs/march_slab.h"
#include "query/slabs/slab_plan.h"
#include "query/slabs/slab_reader.h"

namespace isonest::detail {

/// As many marchers as work at a time: each serves slab after slab. Thread-safe.
class SlabMarchers {
  public:
    SlabMarchers(ValueType type, const Int3& nodes, const SlabPlace& place)
        : type_(type), nodes_(nodes), place_(place) {}

    /// Calls f(SlabMarcher&), unless there can be no surface.
    template <class F>
    void with_one(const F& f) {
        std::unique_ptr<SlabMarcher> marcher = take();
        if (marcher) {
            f(*marcher);
            const std::lock_guard lock(mutex_);
            free_.push_back(std::move(marcher));
        }
    }

  private:
    std::unique_ptr<SlabMarcher> take() {
        {
            const std::lock_guard lock(mutex_);
            if (!free_.empty()) {
                std::unique_ptr<SlabMarcher> marcher = std::move(free_.back());
                free_.pop_back();
                return marcher;
            }
        }
        return make_slab_marcher(type_, nodes_, place_);
    }

    ValueType type_;
    Int3 nodes_;
    SlabPlace place_;
    std::mutex mutex_;
    std::vector<std::unique_ptr<SlabMarcher>> free_;
};

/// Reads slabs in order, calls compute(layers, planes) for each in parallel and use(result) in
/// order. `phase`: of the progress.
template <class Result, class Compute, class Use>
void each_slab(SlabReader& reader, std::int64_t layers, const SlabPlan& plan, const char* phase,
               Progress& progress, const Compute& compute, const Use& use) {
    struct Task {
        Slab layers;
        SlabPlanes planes;
        Result result;
    };
    progress.begin(phase, static_cast<std::uint64_t>(layers), "layers");
    std::int64_t next = 0;
    using Token = std::shared_ptr<Task>;
    const auto read = tbb::make_filter<void, Token>(
        tbb::filter_mode::serial_in_order, [&](tbb::flow_control& control) -> Token {
            if (next == layers) {
                control.stop();
                return nullptr;
            }
            progress.check();
            const Slab slab{next, std::min(next + plan.layers, layers)};
            next = slab.end;
            return std::make_shared<Task>(Task{slab, reader.read(slab), {}});
        });
    const auto work = tbb::make_filter<Token, Token>(tbb::filter_mode::parallel, [&](Token task) {
        task->result = compute(task->layers, task->planes);
        task->planes = {};
        return task;
    });
    const auto hand_over =
        tbb::make_filter<Token, void>(tbb::filter_mode::serial_in_order, [&](const Token& task) {
            use(std::move(task->result));
            progress.advance(static_cast<std::uint64_t>(task->layers.end - task->layers.begin));
        });
    tbb::parallel_pipeline(static_cast<std::size_t>(plan.slabs_at_once), read & work & hand_over);
}

}  // namespace isonest::detail
