// Recursive traversals of a remote store: preceding walks find what they will read.
//
// A recursion finds out that it needs a chunk only when it reaches one of its nodes, and would wait
// a round trip for each. So the next subtrees are first walked without any action, down to one
// level after another. What the elements there will read is prefetched together, and read by the
// next walk. Walks end where the traversal ends, by the same tests. The last walks collect what the
// leaves need, until nothing new is found. Chunks may use half of the cache: if all subtrees need
// more, only the first ones are walked, and the others later.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "query/march/vertex_attributes.h"
#include "query/traverse/adapt_traverse.h"
#include "query/traverse/remote/brick_needs.h"

namespace isonest::detail {

/// The chunks that a walk needs and that are not yet prefetched. Not thread-safe.
class Wants {
  public:
    /// `prefetched` must outlive it.
    explicit Wants(const TraversalNeeds& prefetched) : prefetched_(&prefetched) {}

    /// Whether the chunk was prefetched, or does not exist in the array.
    bool chunk(const ArrayInfo& array, const Int3& chunk) {
        return want(array, chunk, prefetched_->own, found_.own);
    }
    /// The same for the store from which vertex values are taken.
    bool other_chunk(const ArrayInfo& array, const Int3& chunk) {
        return want(array, chunk, prefetched_->values, found_.values);
    }
    /// The chunks of nodes `low` to `high`, or of the nearest ones. Returns whether all were
    /// prefetched.
    bool box(const ArrayInfo& array, const Int3& low, const Int3& high) {
        const Int3 last = array.nodes - Int3{1, 1, 1};
        const Int3 from = array.chunk_of(min(max(low, {0, 0, 0}), last));
        const Int3 size = array.chunk_of(max(min(high, last), {0, 0, 0})) - from + Int3{1, 1, 1};
        bool prefetched = true;
        for (std::int64_t i = 0; i < size.product(); ++i) {
            prefetched = chunk(array, from + size.unlinear(i)) && prefetched;
        }
        return prefetched;
    }
    [[nodiscard]] const TraversalNeeds& found() const { return found_; }

  private:
    static bool want(const ArrayInfo& array, const Int3& chunk, const ChunkNeeds& prefetched,
                     ChunkNeeds& found) {
        if (!array.has_chunk(chunk) || prefetched.contains(array, chunk)) {
            return true;
        }
        found.add(array, chunk);
        return false;
    }

    const TraversalNeeds* prefetched_;
    TraversalNeeds found_;
};

/// One walk of a subtree. `at_leaves` false: down to elements of `level`, which are not visited;
/// collects what they read. True: down to the leaves above `level`; collects what these read.
struct LookWalk {
    int level;
    bool at_leaves;
};

/// Prefetches what the first of `subtrees` read from `coarsest` down to `finest` and, if
/// `at_leaves`, at their leaves. Returns the number of those subtrees, at least 1; if one subtree
/// alone needs more than half of the cache, not all of it may be prefetched. make() makes a
/// thread's scout: scout(subtree, LookWalk, Wants&). `values`: the cache of the store of vertex
/// values; may be null. Throws what the chunk source throws.
template <class Subtree, class Make>
std::size_t look_ahead(ChunkCache& cache, ChunkCache* values, std::span<const Subtree> subtrees,
                       int coarsest, int finest, bool at_leaves, const Make& make) {
    using Scout = std::invoke_result_t<Make>;
    const std::uint64_t most = cache.budget() / 2;
    const std::uint64_t max_values = values != nullptr ? values->budget() / 2 : 0;
    const std::size_t batch = 4 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
    TraversalNeeds prefetched;
    std::size_t count = subtrees.size();
    const auto is_full = [&](const TraversalNeeds& fresh, const TraversalNeeds& next) {
        return prefetched.own.bytes() + fresh.own.bytes() + fresh.own.more_bytes(next.own) > most ||
               prefetched.values.bytes() + fresh.values.bytes() +
                       fresh.values.more_bytes(next.values) >
                   max_values;
    };
    // Returns whether there was something to prefetch.
    const auto walk = [&](const LookWalk& how) {
        TraversalNeeds fresh;
        tbb::enumerable_thread_specific<Scout> scouts(make);
        for (std::size_t first = 0; first < count; first += batch) {
            std::vector<Wants> wants(std::min(batch, count - first), Wants(prefetched));
            tbb::parallel_for(std::size_t{0}, wants.size(), [&](std::size_t i) {
                scouts.local()(subtrees[first + i], how, wants[i]);
            });
            for (std::size_t i = 0; i < wants.size(); ++i) {
                if (is_full(fresh, wants[i].found())) {
                    count = std::max<std::size_t>(first + i, 1);
                    if (first + i > 0) {
                        break;
                    }
                }
                fresh.add(wants[i].found());
            }
        }
        if (fresh.own.chunks().empty() && fresh.values.chunks().empty()) {
            return false;
        }
        cache.prefetch(fresh.own.chunks());
        if (values != nullptr) {
            values->prefetch(fresh.values.chunks());
        }
        prefetched.add(fresh);
        return true;
    };
    for (int level = coarsest; level >= finest; --level) {
        walk({level, false});
    }
    while (at_leaves && walk({finest - 1, true})) {
    }
    return count;
}

/// Divides elements, in order, into windows: one window if the store is local; if it is remote, as
/// many elements as look_ahead() has prefetched. Not thread-safe.
class LookWindows {
  public:
    explicit LookWindows(bool is_remote) : is_remote_(is_remote) {}

    /// look(remaining elements) prefetches the needs of the first of them and returns their number;
    /// then visit(those) is called.
    template <class T, class Look, class Visit>
    void for_each(std::span<const T> elements, const Look& look, const Visit& visit) {
        while (!elements.empty()) {
            std::size_t count = elements.size();
            if (is_remote_) {
                const std::size_t given = std::min(max_, elements.size());
                count = look(elements.first(given));
                note(count, given);
            }
            visit(elements.first(count));
            elements = elements.subspan(count);
        }
    }

  private:
    /// Walking elements that look() does not take, because they need too many chunks, is wasted.
    /// So it is then given at most twice as many as it took, and twice as many again each time it
    /// takes all.
    void note(std::size_t taken, std::size_t given) {
        constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();
        if (taken < given) {
            max_ = 2 * taken;
        } else if (given == max_) {
            max_ = max_ > kAll / 2 ? kAll : 2 * max_;
        }
    }

    bool is_remote_;
    std::size_t max_ = std::numeric_limits<std::size_t>::max();
};

// Which chunks a vertex on an edge of the nested grid needs, if the store is remote.

/// Not thread-safe; one per thread.
class EdgeNeeds {
  public:
    /// The run must outlive it.
    explicit EdgeNeeds(const TraversalRun& run);

    /// Adds the needs of a vertex's attributes and, if vertices are exact, of its position, as far
    /// as they follow from the prefetched data. Throws what the cache throws.
    void edge(const Int3& a, double a_value, const Int3& b, double b_value, Wants& wants);
    /// The same for a vertex at a node.
    void node(const Int3& p, Wants& wants);
    /// The same for the position only.
    void crossing(const Int3& a, double a_value, const Int3& b, double b_value, Wants& wants);
    /// Releases all chunks.
    void leave() { values_.leave(); }

  private:
    void attributes(const Int3& a, const Int3& b, Wants& wants);
    void finer(const FinestCrossing::Edge& edge, int level, Wants& wants) const;

    const TraversalQuery& query_;
    const StoreLayout& layout_;
    NodeSampler values_;
};

// Finds where exact vertices are searched, by processing a brick in advance without its mesh.

/// An exact vertex is found by halving its edge, with a value of the next finer level for each
/// step. The edges of a brick's leaves are known when the brick is done; their needs, only as far
/// as data is prefetched. So the brick is processed repeatedly until nothing more is needed. Brick:
/// a BrickTraversal.
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
            edges_.push_back(
                std::make_unique<Edges>([run = run.get()] { return EdgeNeeds(*run); }));
        }
    }
    CrossingRehearsal(const CrossingRehearsal&) = delete;
    CrossingRehearsal& operator=(const CrossingRehearsal&) = delete;

    /// Adds the needs of the brick's leaves. Throws what the chunk source throws. Thread-safe.
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
    /// A thread's current work.
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

// What AdaptTraverse reads from a remote store, for look_ahead().

/// A scout of subtrees that are whole elements. needs.element(t, Wants&) adds what the tests and
/// the refinement of t read; needs.leaf(t, numbers, Wants&) adds what the processing of a leaf
/// reads. Not thread-safe.
template <class T, class Numbers, class Region, class Interest, class Stop, class Needs>
class ElementScout {
  public:
    ElementScout(Numbers numbers, const Region& region, const Interest& interest, const Stop& stop,
                 Needs needs)
        : numbers_(std::move(numbers)),
          region_(region),
          traversal_(numbers_, region, interest, stop),
          needs_(std::move(needs)) {}
    ElementScout(const ElementScout&) = delete;
    ElementScout& operator=(const ElementScout&) = delete;

    void operator()(const T& subtree, const LookWalk& walk, Wants& wants) {
        auto leaf = [&](const T& t, double, Overlap) {
            if (walk.at_leaves) {
                needs_.leaf(t, numbers_, wants);
            }
        };
        left_.clear();
        if (walk.level < 0) {
            traversal_.subtree(subtree, leaf);
        } else {
            traversal_.above(subtree, walk.level, leaf, left_);
        }
        for (const T& t : left_) {
            if (!walk.at_leaves && region_.overlap(t) != Overlap::outside) {
                needs_.element(t, wants);
            }
        }
    }

  private:
    Numbers numbers_;
    Region region_;
    AdaptTraverse<T, Numbers, Region, Interest, Stop> traversal_;
    Needs needs_;
    std::vector<T> left_;
};

template <class T, class Numbers, class Region, class Interest, class Stop, class Needs>
ElementScout<T, Numbers, Region, Interest, Stop, Needs> element_scout(Numbers numbers,
                                                                      const Region& region,
                                                                      const Interest& interest,
                                                                      const Stop& stop,
                                                                      Needs needs) {
    return {std::move(numbers), region, interest, stop, std::move(needs)};
}

/// What is read for a leaf: data for vertices on its edges, or at its nodes.
enum class LeafReads { nothing, edges, nodes };

/// Adds the values between an element's level and the next. REQUIRES: t.level > 0.
template <int D>
void want_values(const StoreLayout& layout, const Element<D>& t, Wants& wants) {
    const auto [low, high] = t.bounds();
    const int finer = t.level - 1;
    wants.box(layout.array(finer, Field::values), {low.x >> finer, low.y >> finer, low.z >> finer},
              {high.x >> finer, high.y >> finer, high.z >> finer});
}

/// The same for an indicator.
template <int D>
void want_field(const StoreLayout& layout, const Element<D>& t, Field field, Wants& wants) {
    const auto [low, high] = t.bounds();
    const ArrayInfo& array = layout.array(t.level, field);
    wants.box(array, {low.x >> t.level, low.y >> t.level, low.z >> t.level},
              {high.x >> t.level, high.y >> t.level, high.z >> t.level});
    if (array.first_slot > 0) {
        // Numbers that are not stored are computed from the values around them.
        wants.box(layout.array(0, Field::values), low - Int3{1, 1, 1}, high + Int3{2, 2, 2});
    }
}

/// The needs of simplices.
class SimplexNeeds {
  public:
    /// `fields`: fields of the store that the tests use.
    SimplexNeeds(const TraversalRun& run, std::vector<Field> fields, LeafReads reads)
        : layout_(run.layout()), needs_(run), fields_(std::move(fields)), reads_(reads) {}

    /// Adds the numbers between an element's level and the next.
    template <int D>
    void element(const Element<D>& t, Wants& wants) const {
        if (t.level == 0) {
            return;
        }
        want_values(layout_, t, wants);
        for (const Field field : fields_) {
            want_field(layout_, t, field, wants);
        }
    }
    template <int D, class Numbers>
    void leaf(const Element<D>& t, Numbers& /*numbers*/, Wants& wants) {
        if (!t.is_complete() || reads_ == LeafReads::nothing) {
            return;
        }
        for (std::size_t i = 0; i < t.v.size(); ++i) {
            if (reads_ == LeafReads::nodes) {
                needs_.node(t.v[i], wants);
                continue;
            }
            for (std::size_t j = i + 1; j < t.v.size(); ++j) {
                needs_.edge(t.v[i], t.value[i], t.v[j], t.value[j], wants);
            }
        }
    }

  private:
    const StoreLayout& layout_;
    EdgeNeeds needs_;
    std::vector<Field> fields_;
    LeafReads reads_;
};

}  // namespace isonest::detail
