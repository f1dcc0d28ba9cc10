#include "query/traverse/planar.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "query/traverse/adapt_traverse.h"
#include "query/traverse/element_tests.h"
#include "query/traverse/far/element_scout.h"
#include "query/traverse/height_rounding.h"
#include "query/traverse/subtree_walk.h"
#include "query/view/node_sampler.h"

namespace isonest::detail {
namespace {

/// Collects what the leaves hold as parts of a mesh. One per thread.
class PlanarAction {
  public:
    PlanarAction(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                 const PartSink& sink, Progress& progress)
        : attributes_(query.attributes, cache, query.attribute_values),
          parts_(query.box, part_vertices, sink, progress),
          crossing_(cache, query.iso),
          mesh_(&attributes_, false, query.vertices == VertexPlace::exact ? &crossing_ : nullptr) {}
    PlanarAction(const PlanarAction&) = delete;
    PlanarAction& operator=(const PlanarAction&) = delete;

    void begin(std::uint64_t subtree) { parts_.begin(subtree); }
    void flush() { parts_.flush(mesh_); }
    /// Of the leaves that were complete.
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = counts_;
        counts.value_rounding.add(attributes_.value_rounding());
        return counts;
    }

  protected:
    /// The corners of a leaf, which is counted; nothing if a value is missing.
    std::optional<std::array<Corner, 3>> corners_of(const Element<2>& leaf, double eta) {
        if (!leaf.is_complete()) {
            return std::nullopt;
        }
        ++counts_.leaves;
        counts_.error_bound = std::max(counts_.error_bound, eta);
        std::array<Corner, 3> corners;
        for (std::size_t i = 0; i < 3; ++i) {
            corners[i] = {leaf.v[i], leaf.value[i]};
        }
        return corners;
    }
    void flush_if_full() { parts_.flush_if_full(mesh_); }

  private:
    AttributeSampler attributes_;
    SubtreeParts parts_;
    FinestCrossing crossing_;

  protected:
    TraversalCounts counts_;
    LocalMesh mesh_;
};

class MarchLines : public PlanarAction {
  public:
    MarchLines(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
               const PartSink& sink, Progress& progress)
        : PlanarAction(cache, query, part_vertices, sink, progress), iso_(query.iso) {}
    void operator()(const Element<2>& leaf, double eta, Overlap where) {
        if (const auto corners = corners_of(leaf, eta)) {
            mesh_.march_line(*corners, iso_, where == Overlap::crossing);
            flush_if_full();
        }
    }

  private:
    double iso_;
};

class AddGraph : public PlanarAction {
  public:
    AddGraph(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
             const PartSink& sink, Progress& progress)
        : PlanarAction(cache, query, part_vertices, sink, progress),
          scale_(query.attributes.graph_scale.value_or(1)) {}
    void operator()(const Element<2>& leaf, double eta, Overlap where) {
        if (const auto corners = corners_of(leaf, eta)) {
            const bool cut = where == Overlap::crossing;
            mesh_.add_graph(*corners, cut);
            counts_.height_rounding =
                std::max(counts_.height_rounding, height_rounding(*corners, scale_, cut));
            flush_if_full();
        }
    }

  private:
    double scale_;
};

/// One thread's traversal and what it does with the leaves.
template <class Interest, class Action>
class PlanarWorker {
  public:
    PlanarWorker(ChunkCache& cache, const TraversalQuery& query, const Interest& interest,
                 std::size_t part_vertices, const PartSink& sink, Progress& progress)
        : numbers_(cache),
          traversal_(numbers_, InBox{query.box}, interest, StopsBelow{query.tolerance, query.stop}),
          action_(cache, query, part_vertices, sink, progress),
          progress_(progress) {}
    PlanarWorker(const PlanarWorker&) = delete;
    PlanarWorker& operator=(const PlanarWorker&) = delete;

    void begin(std::uint64_t subtree) {
        finished_ = traversal_.counts().finished;
        action_.begin(subtree);
    }
    void flush() {
        action_.flush();
        progress_.advance(traversal_.counts().finished - finished_);
    }
    [[nodiscard]] std::vector<Element<2>> roots(const Lattice& lattice) {
        return traversal_.roots(lattice);
    }
    void above(const Lattice& lattice, int level_left, std::vector<Element<2>>& left) {
        for (const Element<2>& t : traversal_.roots(lattice)) {
            traversal_.above(t, level_left, action_, left);
        }
    }
    void subtree(const Element<2>& t) { traversal_.subtree(t, action_); }
    [[nodiscard]] TraversalCounts counts() const {
        TraversalCounts counts = action_.counts();
        counts.visited = traversal_.counts().visited;
        return counts;
    }

  private:
    NodeSampler numbers_;
    AdaptTraverse<2, NodeSampler, InBox, Interest, StopsBelow> traversal_;
    Action action_;
    Progress& progress_;
    std::uint64_t finished_ = 0;  ///< before the subtree
};

/// What the vertices of a leaf are made from.
class LeafEdges {
  public:
    LeafEdges(ChunkCache& cache, const TraversalQuery& query, bool is_graph)
        : needs_(cache, query), is_graph_(is_graph) {}
    void operator()(const Element<2>& leaf, Wants& wants) {
        if (!leaf.is_complete()) {
            return;
        }
        for (std::size_t i = 0; i < 3; ++i) {
            const std::size_t next = (i + 1) % 3;
            if (is_graph_) {
                needs_.node(leaf.v[i], wants);
            } else {
                needs_.edge(leaf.v[i], leaf.value[i], leaf.v[next], leaf.value[next], wants);
            }
        }
    }

  private:
    EdgeNeeds needs_;
    bool is_graph_;
};

/// The store's fields that the tests ask for.
template <class Interest>
std::vector<Field> asked_fields(const Interest& interest, const TraversalQuery& query) {
    std::vector<Field> fields;
    if (const auto field = interest.field()) {
        fields.push_back(*field);
    }
    if (!query.tolerance.is_zero()) {
        fields.push_back(query.stop);
    }
    return fields;
}

template <class Interest>
using PlanarScout = ElementScout<2, NodeSampler, InBox, Interest, StopsBelow, LeafEdges>;

/// Levels below the coarsest at which the subtrees begin that are the threads' work: at most 2 *
/// 4^5 of them.
constexpr int kTopLevels = 5;

template <class Action, class Interest>
TraversalCounts run(ChunkCache& cache, const TraversalQuery& query, const Interest& interest,
                    std::size_t part_vertices, const PartSink& sink, Progress& progress) {
    const Lattice& lattice = cache.source().layout().lattice();
    const int level_left = std::max(lattice.top() - kTopLevels, 0);
    const bool is_graph = std::is_same_v<Action, AddGraph>;
    using Worker = PlanarWorker<Interest, Action>;
    const auto look = [&](std::span<const Element<2>> subtrees, int coarsest, int finest) {
        return look_ahead(cache, query.attribute_values, subtrees, coarsest, finest, true, [&] {
            return PlanarScout<Interest>(
                cache.source().layout(), NodeSampler(cache), InBox{query.box}, interest,
                StopsBelow{query.tolerance, query.stop}, asked_fields(interest, query),
                LeafEdges(cache, query, is_graph));
        });
    };
    return walk_subtrees<Element<2>>(
        cache.source().is_far(),
        [&] { return Worker(cache, query, interest, part_vertices, sink, progress); },
        [&](Worker& worker, std::vector<Element<2>>& left) {
            if (cache.source().is_far()) {
                const std::vector<Element<2>> roots = worker.roots(lattice);
                look(roots, lattice.top(), level_left + 1);
            }
            worker.above(lattice, level_left, left);
        },
        [](Worker& worker, const Element<2>& t) { worker.subtree(t); },
        [&](std::span<const Element<2>> subtrees) { return look(subtrees, level_left, 0); });
}

}  // namespace

TraversalCounts traverse_planar(ChunkCache& cache, const TraversalQuery& query, PlanarKind kind,
                                std::size_t part_vertices, const PartSink& sink,
                                Progress& progress) {
    const StoreLayout& layout = cache.source().layout();
    const std::uint64_t edge = std::uint64_t{1} << static_cast<unsigned>(layout.lattice().top());
    progress.begin("extract", 2 * edge * edge, "");
    if (kind == PlanarKind::graph) {
        return run<AddGraph>(cache, query, Everything{}, part_vertices, sink, progress);
    }
    return run<MarchLines>(cache, query,
                           HoldsIsovalue{query.iso, query.bound, layout.header().spacing},
                           part_vertices, sink, progress);
}

}  // namespace isonest::detail
