// Marches the hexahedral cells of a slab of a volume in memory.
#pragma once

#include <oneapi/tbb/parallel_pipeline.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/value_type.h>

#include "query/slabs/slab_reader.h"

namespace isonest::detail {

// The side of the isovalue for the nodes of a row, one bit each.

/// Number of 64-bit words for a row of this many nodes.
constexpr std::size_t words_of(std::int64_t nodes) {
    return static_cast<std::size_t>((nodes + 63) / 64);
}

/// Determines the sides for one isovalue.
template <class T>
class NodeBits {
  public:
    /// REQUIRES: crosses(iso).
    explicit NodeBits(double iso);
    /// Whether finite values can be on both sides.
    static bool crosses(double iso);

    /// Bit x of `below`: node x is below the isovalue; of `special`: it has the isovalue, or its
    /// value is missing. Both have words_of(nodes) words; bits behind the row are 0. Returns
    /// whether any node is special.
    bool of_row(const T* row, std::int64_t nodes, std::uint64_t* below,
                std::uint64_t* special) const;

  private:
    T limit_;       ///< the smallest number that is not below the isovalue
    T hit_;         ///< the number equal to the isovalue; for floats NaN if there is none
    bool special_;  ///< special nodes are possible
};

/// Extends the range [low, high] by the finite ones of `count` values.
template <class T>
void widen_range(const T* values, std::int64_t count, double& low, double& high);

/// The surface {U = iso} in slabs of one volume, the same as by march_finest_brick(). Tables are
/// made once and reused for each slab. Not thread-safe.
class SlabMarcher {
  public:
    SlabMarcher() = default;
    SlabMarcher(const SlabMarcher&) = delete;
    SlabMarcher& operator=(const SlabMarcher&) = delete;
    virtual ~SlabMarcher() = default;

    /// The surface in the cells of `layers`. REQUIRES: the planes of the layers are loaded and,
    /// with normals, the adjacent planes, if the volume has them.
    virtual MarchedSlab march(const SlabPlanes& planes, const Slab& layers,
                              const SlabEstimate& likely) = 0;
    /// The same in parts; their `shared` names what other parts may also have. A part ends with the
    /// row of cells in which its weight (SlabVertices) reaches `most`. Calls part(number, surface);
    /// numbers ascend over all slabs of the volume.
    virtual void march_parts(const SlabPlanes& planes, const Slab& layers, std::size_t most,
                             const std::function<void(std::uint64_t, MarchedSlab&&)>& part) = 0;
};

/// Returns null if values of the type cannot be on both sides: then there is no surface. REQUIRES:
/// no axis has only one node.
std::unique_ptr<SlabMarcher> make_slab_marcher(ValueType type, const Int3& nodes,
                                               const SlabPlace& place);

/// Heap of a marcher in addition to the slab, bytes.
std::uint64_t march_slab_bytes(const Int3& nodes);

// Slabs of a volume, read in order and processed in parallel.

/// A pool of marchers, one for each concurrent slab; each is reused for further slabs. Thread-safe.
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

/// Reads slabs in order; calls compute(layers, planes) for each in parallel and use(result) in
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
