// Where exact vertices are looked for, found by doing a brick before, without its mesh.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "query/traverse/far/edge_needs.h"

namespace isonest::detail {

/// An exact vertex is found by halving its edge, each half by a value of the next finer level. So
/// the edges of a brick's leaves are known when the brick is done, and what they need as far as
/// what is announced says: the brick is done again until they need no more. Brick: a
/// BrickTraversal.
template <class Brick>
class CrossingRehearsal {
  public:
    /// The runs must outlive it.
    explicit CrossingRehearsal(Runs runs) {
        for (const auto& run : runs) {
            TraversalQuery query = run->query;
            query.vertices = VertexPlace::linear;
            query.attributes = {};
            query.attribute_values = nullptr;
            query.on_leaf = [this](const Leaf& leaf) { want(leaf); };
            queries_.push_back(std::make_unique<TraversalQuery>(std::move(query)));
            runs_.push_back(std::make_unique<TraversalRun>(
                run->cache, *queries_.back(), std::min(run->part_vertices, kFewVertices), nothing_,
                run->progress));
            edges_.push_back(std::make_unique<Edges>(
                [run = run.get()] { return EdgeNeeds(run->cache, run->query); }));
        }
    }
    CrossingRehearsal(const CrossingRehearsal&) = delete;
    CrossingRehearsal& operator=(const CrossingRehearsal&) = delete;

    /// What the brick's leaves want. Throws what the chunk source throws. Thread-safe.
    void operator()(int level, const Int3& brick, const ParentsOfRuns& parents, Wants& wants) {
        Task& task = tasks_.local();
        task.wants = &wants;
        for (std::size_t r = 0; r < runs_.size(); ++r) {
            if (!parents.empty() && parents[r] == nullptr) {
                continue;
            }
            task.edges = &edges_[r]->local();
            task.iso = runs_[r]->query.iso;
            Brick work(*runs_[r], level, brick);
            if (parents.empty()) {
                work.root();
            } else {
                work.refine_parents(parents[r]->masks, parents[r]->begin);
            }
            task.edges->leave();
        }
    }

  private:
    static constexpr std::size_t kFewVertices = 4096;
    using Edges = tbb::enumerable_thread_specific<EdgeNeeds>;
    /// What a thread is at.
    struct Task {
        EdgeNeeds* edges = nullptr;
        Wants* wants = nullptr;
        double iso = 0;
    };

    void want(const Leaf& leaf) {
        const Task& task = tasks_.local();
        for (std::size_t i = 0; i < 4 && leaf.level > 0; ++i) {
            for (std::size_t j = i + 1; j < 4; ++j) {
                const Corner& a = leaf.corners[i];
                const Corner& b = leaf.corners[j];
                if ((a.value < task.iso) != (b.value < task.iso)) {
                    task.edges->crossing(a.node, a.value, b.node, b.value, *task.wants);
                }
            }
        }
    }

    PartSink nothing_ = [](std::uint64_t, const MeshPart&) {};
    std::vector<std::unique_ptr<TraversalQuery>> queries_;
    std::vector<std::unique_ptr<TraversalRun>> runs_;
    std::vector<std::unique_ptr<Edges>> edges_;
    tbb::enumerable_thread_specific<Task> tasks_;
};

}  // namespace isonest::detail
