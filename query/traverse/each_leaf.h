// Traversal of the whole domain: every leaf of the mesh that a stop test defines, with or without
// surface. This is the mesh of section 7 of the paper: no element is stored, the leaves of
// AdaptTraverse are the mesh.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/progress.h>

#include "query/march/local_mesh.h"
#include "query/traverse/adapt_traverse.h"
#include "query/traverse/bricks/brick_parts.h"
#include "query/traverse/remote/look_ahead.h"
#include "query/traverse/traversal.h"
#include "query/values/node_sampler.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

// Parallel AdaptTraverse that produces the parts of a mesh: one thread visits the coarse elements,
// all threads share the subtrees below.

/// Base of actions that make a mesh. It manages the parts that one thread makes, subtree by
/// subtree. A derived action receives leaves (SimplexAction) and has numbers(), the NodeNumbers of
/// its traversal. One per thread.
class SubtreeMesh {
  public:
    explicit SubtreeMesh(TraversalRun& run)
        : run_(run),
          attributes_(run.query.attributes, run.cache, run.query.attribute_values),
          crossing_(run.cache, run.query.iso),
          mesh_(&attributes_, run.query.plane.has_value(),
                run.query.vertices == VertexPlace::exact ? &crossing_ : nullptr) {}
    SubtreeMesh(const SubtreeMesh&) = delete;
    SubtreeMesh& operator=(const SubtreeMesh&) = delete;

    /// Starts a subtree: the part numbers that follow start with the subtree's number.
    void begin(std::uint64_t subtree) {
        constexpr unsigned kPartBits = 20;
        parts_ = subtree << kPartBits;
    }
    /// Passes the current part to the sink. Throws what the sink throws, and Error{cancelled}.
    void flush() {
        run_.progress.check();
        if (!mesh_.empty()) {
            run_.sink(parts_++, mesh_.finish(run_.query.box));
        }
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.value_rounding.add(attributes_.value_rounding());
        return counts;
    }

  protected:
    void flush_if_full() {
        if (mesh_.size() >= run_.part_vertices) {
            flush();
        }
    }
    void count_leaf(double stopped_at) {
        ++counts_.leaves;
        counts_.stopped_at = std::max(counts_.stopped_at, stopped_at);
    }

    TraversalRun& run_;
    AttributeSampler attributes_;

  private:
    FinestCrossing crossing_;

  protected:
    LocalMesh mesh_;
    TraversalCounts counts_;

  private:
    std::uint64_t parts_ = 0;
};

/// One thread's traversal of subtrees, with the action for their leaves.
template <class T, class Interest, class Stop, class Action>
class SubtreeWorker {
  public:
    /// `make_action`: creates the Action.
    template <class MakeAction>
    SubtreeWorker(TraversalRun& run, const Interest& interest, const Stop& stop,
                  const MakeAction& make_action)
        : run_(run),
          action_(make_action()),
          interest_(interest),
          stop_(stop),
          traversal_(make_traversal()) {}
    SubtreeWorker(const SubtreeWorker&) = delete;
    SubtreeWorker& operator=(const SubtreeWorker&) = delete;

    [[nodiscard]] std::vector<T> roots() { return traversal_.roots(run_.layout().lattice()); }
    /// Visits, as subtree 0, everything above `level`, and adds the whole elements of that level to
    /// `left`. The leaves found here belong to the rank that owns the first cell; other ranks
    /// ignore them.
    void above(int level, std::vector<T>& left) {
        if (!run_.query.share.owns(0, {0, 0, 0})) {
            auto nothing = [](const T&, double, Overlap) {};
            Traversal traversal = make_traversal();
            for (const T& t : roots()) {
                traversal.above(t, level, nothing, left);
            }
            return;
        }
        action_.begin(0);
        for (const T& t : roots()) {
            traversal_.above(t, level, action_, left);
        }
        action_.flush();
    }
    void subtree(std::uint64_t number, const T& t) {
        action_.begin(number);
        traversal_.subtree(t, action_);
        action_.flush();
    }
    /// Counts of the finished subtrees.
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = action_.counts();
        counts.visited = traversal_.counts().visited;
        return counts;
    }

  private:
    using Numbers = std::remove_reference_t<decltype(std::declval<Action&>().numbers())>;
    using Traversal = AdaptTraverse<T, Numbers, InBox, Interest, Stop>;

    [[nodiscard]] Traversal make_traversal() {
        return Traversal(action_.numbers(), InBox{run_.query.box}, interest_, stop_);
    }

    TraversalRun& run_;
    Action action_;
    Interest interest_;
    Stop stop_;
    Traversal traversal_;
};

/// The workers of all threads.
template <class Worker>
class SubtreeWorkers {
  public:
    template <class Make>
    explicit SubtreeWorkers(const Make& make) : workers_(make) {}

    [[nodiscard]] Worker& local() { return workers_.local(); }
    /// Releases all chunks held by workers; the counts are kept.
    void leave() {
        counts_ = counts();
        workers_.clear();
    }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        for (const Worker& worker : workers_) {
            counts.add(worker.counts());
        }
        return counts;
    }

  private:
    tbb::enumerable_thread_specific<Worker> workers_;
    TraversalCounts counts_;
};

/// Visits the leaves of all elements T, within a subtree in the order of the traversal. The
/// subtrees that threads process start `top_levels` below the coarsest level; only those that start
/// in the query's share are visited. make_action() creates a thread's action; make_scout() creates
/// its ElementScout if the store is remote. Throws what the chunk source and the sink throw, and
/// Error{cancelled}.
template <class T, class Interest, class Stop, class MakeAction, class MakeScout>
TraversalCounts traverse_subtrees(TraversalRun& run, const Interest& interest, const Stop& stop,
                                  int top_levels, const MakeAction& make_action,
                                  const MakeScout& make_scout) {
    using Worker = SubtreeWorker<T, Interest, Stop, std::invoke_result_t<MakeAction>>;
    const int top = run.layout().lattice().top();
    const int level = std::max(top - top_levels, 0);
    const bool is_remote = run.cache.source().is_remote();
    SubtreeWorkers<Worker> workers([&] { return Worker(run, interest, stop, make_action); });
    const auto look = [&](std::span<const T> elements, int coarsest, int finest) {
        return look_ahead(run.cache, run.query.attribute_values, elements, coarsest, finest, true,
                          make_scout);
    };
    std::vector<T> subtrees;
    if (is_remote) {
        look(workers.local().roots(), top, level + 1);
    }
    workers.local().above(level, subtrees);
    run.progress.begin("extract", subtrees.size(), "");
    // In Morton order, so a share is a contiguous range.
    const auto is_shared = [&](const T& t) {
        const Int3 low = t.bounds().first;
        return run.query.share.owns(level, {low.x >> level, low.y >> level, low.z >> level});
    };
    const auto begin = std::find_if(subtrees.begin(), subtrees.end(), is_shared);
    const auto end = std::find_if_not(begin, subtrees.end(), is_shared);
    run.progress.advance(subtrees.size() - static_cast<std::size_t>(end - begin));
    LookWindows windows(is_remote);
    windows.for_each(
        std::span<const T>(subtrees).subspan(static_cast<std::size_t>(begin - subtrees.begin()),
                                             static_cast<std::size_t>(end - begin)),
        [&](std::span<const T> next) {
            workers.leave();
            return look(next, level, 0);
        },
        [&](std::span<const T> window) {
            const auto first = static_cast<std::size_t>(window.data() - subtrees.data());
            tbb::parallel_for(std::size_t{0}, window.size(), [&](std::size_t i) {
                workers.local().subtree(first + i + 1, window[i]);
                run.progress.advance(1);
            });
        });
    return workers.counts();
}

/// A leaf as passed on by for_each_leaf().
template <int D>
struct DomainLeaf {
    Element<D> element;  ///< vertices in coordinates of the finest lattice, values and level
    double eta = 0;      ///< number of the stop test's field at the refinement node; 0 at the
                         ///< finest level
    bool cut = false;    ///< extends beyond the box
};

/// Receives leaves in batches of at most kLeavesPerBatch, from many threads. Batches of the same
/// `order` come in sequence from one thread. Sorted by `order`, the sequence of leaves is the same
/// for any number of threads. If empty, the leaves are only counted.
template <int D>
using LeafSink = std::function<void(std::uint64_t order, std::span<const DomainLeaf<D>> leaves)>;
inline constexpr std::size_t kLeavesPerBatch = 1024;

namespace each_leaf {

/// A cube of at most part_levels() levels is one task; larger cubes are divided into cubes
/// levels_between() levels below.
constexpr int levels_between(int dimension) {
    return 10 / dimension;
}

/// Groups the elements by their cubes, in Morton order.
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

/// The parallel traversal: visit(elements, level, below, left) visits the elements of a cube of
/// `level` down to whole elements of level `below`, which it adds to `left`; or, if that is null,
/// all below them. So a task reads data that are close together. REQUIRES: all elements are of kind
/// 0 and belong to the same cube.
template <int D, class Visit>
void visit_cube(const std::vector<Element<D>>& elements, int level, const Visit& visit) {
    if (level <= part_levels<D>(false)) {
        visit(elements, level, 0, nullptr);
        return;
    }
    const int below = level - levels_between(D);
    std::vector<Element<D>> left;
    visit(elements, level, below, &left);
    const auto cubes = by_cube(left, below);
    left = {};
    // Isolated: a waiting thread does not start another cube of this size, so few are open at once.
    tbb::this_task_arena::isolate([&] {
        tbb::parallel_for(std::size_t{0}, cubes.size(),
                          [&](std::size_t i) { visit_cube<D>(cubes[i], below, visit); });
    });
}

}  // namespace each_leaf

/// Visits the whole grid of `lattice` within `region` and passes every leaf to `sink`. `numbers` is
/// copied for each thread. Elements of coarse levels that extend beyond the volume are not clipped;
/// those entirely outside the region are not visited. Missing values are passed on unchanged. Heap
/// besides that of `numbers` and the sink: about 3 MiB per thread, independent of the volume's
/// size. `threads`: 0 = all cores. REQUIRES: lattice.dimension() == D. Throws what numbers
/// and sink throw, and Error{cancelled}.
template <int D, NodeNumbers Numbers, RegionOf<Element<D>> Region,
          IsStopTest<Element<D>, Numbers> Stop>
VisitCounts for_each_leaf(const Lattice& lattice, const Numbers& numbers, const Region& region,
                          const Stop& stop, const LeafSink<D>& sink, int threads,
                          Progress& progress) {
    assert(lattice.dimension() == D);
    using Traversal = AdaptTraverse<Element<D>, Numbers, Region, Everything, Stop>;
    struct Worker {
        Worker(const Numbers& with, const Region& region_, const Stop& stop_)
            : own(with), traversal(own, region_, Everything{}, stop_) {}
        Worker(const Worker&) = delete;
        Worker& operator=(const Worker&) = delete;
        Numbers own;
        Traversal traversal;
    };
    VisitCounts counts;
    Workers(threads).execute([&] {
        tbb::enumerable_thread_specific<Worker> workers(
            [&] { return Worker(numbers, region, stop); });
        const std::vector<Element<D>> roots = workers.local().traversal.roots(lattice);
        progress.begin("leaves", roots.size() * roots.front().size(), "");
        each_leaf::visit_cube<D>(roots, lattice.top(),
                                 [&](const std::vector<Element<D>>& elements, int level, int below,
                                     std::vector<Element<D>>* left) {
                                     progress.check();
                                     Traversal& traversal = workers.local().traversal;
                                     const std::uint64_t before = traversal.counts().finished;
                                     each_leaf::Batches<D> batches(
                                         cube_order(level, elements.front().bounds().first), sink);
                                     for (const Element<D>& t : elements) {
                                         if (left == nullptr) {
                                             traversal.subtree(t, batches);
                                         } else {
                                             traversal.above(t, below, batches, *left);
                                         }
                                     }
                                     batches.flush();
                                     progress.advance(traversal.counts().finished - before);
                                 });
        for (const Worker& worker : workers) {
            counts.add(worker.traversal.counts());
        }
    });
    return counts;
}

/// The numbers of a store, at nodes of the grid only.
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

/// The same for a store, through its cache. `box`: lattice coordinates, infinite along axes without
/// extent; use volume_box() for the whole volume. A thread holds few chunks per level at a time.
template <int D, IsStopTest<Element<D>, StoreNumbers> Stop>
VisitCounts for_each_leaf(ChunkCache& cache, const Stop& stop, const ClipBox& box,
                          const LeafSink<D>& sink, int threads, Progress& progress) {
    return for_each_leaf<D>(cache.source().layout().lattice(), StoreNumbers(cache), InBox{box},
                            stop, sink, threads, progress);
}

}  // namespace isonest::detail
