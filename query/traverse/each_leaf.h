// The whole domain: every leaf of the mesh that a stop test makes, with or without a surface in it.
//
// The mesh of the paper's section 7: no element is stored, the leaves of AdaptTraverse are the
// mesh.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cassert>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include <isonest/progress.h>

#include "query/traverse/adapt_traverse.h"
#include "query/traverse/bricks/cube_order.h"
#include "query/traverse/element_tests.h"
#include "query/view/node_sampler.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// A leaf as for_each_leaf() hands it out.
template <int D>
struct DomainLeaf {
    Element<D> element;  ///< its vertices in coordinates of the finest lattice, values and level
    double eta = 0;      ///< of the stop test's field at the refinement node; 0 at the finest level
    bool cut = false;    ///< it reaches out of the box
};

/// Receives the leaves in batches of at most kLeavesPerBatch, from many threads. Batches of one
/// `order` come one after another from one thread; sorted by `order`, the leaves are the same
/// sequence for any number of threads. Empty: the leaves are counted, no more.
template <int D>
using LeafSink = std::function<void(std::uint64_t order, std::span<const DomainLeaf<D>> leaves)>;
inline constexpr std::size_t kLeavesPerBatch = 1024;

namespace each_leaf {

/// A cube at most this large is one task; larger ones are cut into cubes this many levels below.
constexpr int largest_task(int dimension) {
    return 15 / dimension;
}
constexpr int levels_between(int dimension) {
    return 10 / dimension;
}

/// The elements' cubes, each with its elements together, in Morton order.
template <int D>
std::vector<std::vector<Element<D>>> by_cube(const std::vector<Element<D>>& elements, int level) {
    std::vector<std::pair<std::uint64_t, const Element<D>*>> sorted;
    sorted.reserve(elements.size());
    for (const Element<D>& t : elements) {
        sorted.emplace_back(cube_order(level, t.bounds().first), &t);
    }
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<std::vector<Element<D>>> cubes;
    for (std::size_t i = 0; i < sorted.size(); ++i) {
        if (i == 0 || sorted[i].first != sorted[i - 1].first) {
            cubes.emplace_back();
        }
        cubes.back().push_back(*sorted[i].second);
    }
    return cubes;
}

/// Collects the leaves of one task.
template <int D>
class Batches {
  public:
    Batches(std::uint64_t order, const LeafSink<D>& sink) : order_(order), sink_(sink) {}
    void operator()(const Element<D>& leaf, double eta, Overlap where) {
        if (!sink_) {
            return;
        }
        leaves_.push_back({leaf, eta, where == Overlap::crossing});
        if (leaves_.size() == kLeavesPerBatch) {
            flush();
        }
    }
    void flush() {
        if (!leaves_.empty()) {
            sink_(order_, leaves_);
            leaves_.clear();
        }
    }

  private:
    std::uint64_t order_;
    const LeafSink<D>& sink_;
    std::vector<DomainLeaf<D>> leaves_;
};

/// The parallel traversal, cube by cube: a task visits the elements of one cube, so that what it
/// reads lies together.
template <int D, class Traversal, NodeNumbers Numbers>
class Tasks {
  public:
    struct Worker {
        Worker(Numbers with, const auto& region, const auto& interest, const auto& stop)
            : numbers(std::move(with)), traversal(numbers, region, interest, stop) {}
        Worker(const Worker&) = delete;
        Worker& operator=(const Worker&) = delete;
        Numbers numbers;
        Traversal traversal;
    };
    Tasks(tbb::enumerable_thread_specific<Worker>& workers, const LeafSink<D>& sink,
          Progress& progress)
        : workers_(workers), sink_(sink), progress_(progress) {}

    /// REQUIRES: the elements are of kind 0 and of the cube of `level` at node `low`.
    void cube(const std::vector<Element<D>>& elements, int level) {
        progress_.check();
        const bool whole = level <= largest_task(D);
        const int below = whole ? 0 : level - levels_between(D);
        std::vector<Element<D>> left;
        {
            Traversal& traversal = workers_.local().traversal;
            const std::uint64_t before = traversal.counts().finished;
            Batches<D> batches(cube_order(level, elements.front().bounds().first), sink_);
            for (const Element<D>& t : elements) {
                if (whole) {
                    traversal.subtree(t, batches);
                } else {
                    traversal.above(t, below, batches, left);
                }
            }
            batches.flush();
            progress_.advance(traversal.counts().finished - before);
        }
        const auto cubes = by_cube(left, below);
        left = {};
        // Isolated: a thread that waits takes no other cube of this size, so few are open at once.
        tbb::this_task_arena::isolate([&] {
            tbb::parallel_for(std::size_t{0}, cubes.size(),
                              [&](std::size_t i) { cube(cubes[i], below); });
        });
    }

  private:
    tbb::enumerable_thread_specific<Worker>& workers_;
    const LeafSink<D>& sink_;
    Progress& progress_;
};

}  // namespace each_leaf

/// Visits the whole grid of `lattice` within `region` and hands every leaf to `sink`. `numbers`:
/// copied for each thread. Elements of the coarser levels that reach out of the volume are cut by
/// nobody; those wholly outside the region are not visited. A missing value is handed out as it is.
/// Heap besides that of `numbers` and the sink: about 3 MiB per thread, whatever the volume's size.
/// `threads`: 0 = as many as the machine has. REQUIRES: lattice.dimension() == D. Throws what
/// numbers and sink throw, and Error{cancelled}.
template <int D, NodeNumbers Numbers, RegionOf<D> Region, IsStopTest<D> Stop>
VisitCounts for_each_leaf(const Lattice& lattice, const Numbers& numbers, const Region& region,
                          const Stop& stop, const LeafSink<D>& sink, int threads,
                          Progress& progress) {
    assert(lattice.dimension() == D);
    using Traversal = AdaptTraverse<D, Numbers, Region, Everything, Stop>;
    using Tasks = each_leaf::Tasks<D, Traversal, Numbers>;
    using Worker = typename Tasks::Worker;
    VisitCounts counts;
    Workers(threads).execute([&] {
        tbb::enumerable_thread_specific<Worker> workers(
            [&] { return Worker(numbers, region, Everything{}, stop); });
        const std::vector<Element<D>> roots = workers.local().traversal.roots(lattice);
        progress.begin("leaves", roots.size() * roots.front().size(), "");
        Tasks(workers, sink, progress).cube(roots, lattice.top());
        for (const Worker& worker : workers) {
            counts.add(worker.traversal.counts());
        }
    });
    return counts;
}

/// A store's numbers, of nodes of the grid alone.
class StoreNumbers {
  public:
    explicit StoreNumbers(ChunkCache& cache) : sampler_(cache) {}
    [[nodiscard]] double value(const Int3& p, int level) { return sampler_.value(p, level); }
    [[nodiscard]] double indicator(const Int3& p, Field field) {
        return sampler_.grid_indicator(p, field);
    }

  private:
    NodeSampler sampler_;
};

/// The same of a store, through its cache. `box`: lattice coordinates, infinite along axes without
/// extent; volume_box() is all. The chunks that a thread holds on to are few per level.
template <int D, IsStopTest<D> Stop>
VisitCounts for_each_leaf(ChunkCache& cache, const Stop& stop, const ClipBox& box,
                          const LeafSink<D>& sink, int threads, Progress& progress) {
    return for_each_leaf<D>(cache.source().layout().lattice(), StoreNumbers(cache), InBox{box},
                            stop, sink, threads, progress);
}

}  // namespace isonest::detail
