// Recursive traversals of a store behind a network: what they will read is found by walks before.
//
// A recursion finds out that it needs a chunk when it comes to one of its nodes, and waits a round
// trip for each. So the subtrees that are next are walked before without doing anything: down to
// one level after another, and what the elements there are going to read is announced together and
// read by the next walk. Walks end where the traversal does, by the same tests. The last ones say
// what the leaves need, until nothing new turns up. Chunks count against half of the cache: where
// all subtrees need more, the first ones are looked at alone, and the others later.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "query/traverse/far/brick_needs.h"

namespace isonest::detail {

/// The chunks that a walk finds to be needed, beside those that are announced already. Not
/// thread-safe.
class Wants {
  public:
    /// `announced` must outlive it.
    explicit Wants(const TraversalNeeds& announced) : announced_(&announced) {}

    /// Whether the chunk was announced, or the array has none such.
    bool chunk(const ArrayInfo& array, const Int3& chunk) {
        return want(array, chunk, announced_->own, found_.own);
    }
    /// Of the store from which vertex values are taken.
    bool other_chunk(const ArrayInfo& array, const Int3& chunk) {
        return want(array, chunk, announced_->values, found_.values);
    }
    /// Those that hold nodes `low` to `high`, or the nearest ones: whether all were announced.
    bool box(const ArrayInfo& array, const Int3& low, const Int3& high) {
        const Int3 last = array.nodes - Int3{1, 1, 1};
        const Int3 from = array.chunk_of(min(max(low, {0, 0, 0}), last));
        const Int3 size = array.chunk_of(max(min(high, last), {0, 0, 0})) - from + Int3{1, 1, 1};
        bool announced = true;
        for (std::int64_t i = 0; i < size.product(); ++i) {
            announced = chunk(array, from + size.unlinear(i)) && announced;
        }
        return announced;
    }
    [[nodiscard]] const TraversalNeeds& found() const { return found_; }

  private:
    static bool want(const ArrayInfo& array, const Int3& chunk, const ChunkNeeds& announced,
                     ChunkNeeds& found) {
        if (!array.has_chunk(chunk) || announced.contains(array, chunk)) {
            return true;
        }
        found.add(array, chunk);
        return false;
    }

    const TraversalNeeds* announced_;
    TraversalNeeds found_;
};

/// One walk of a subtree. Where `at_leaves` is not set: down to elements of `level`, without them,
/// and what they read is wanted. Else down to the leaves above `level`, and what these read is.
struct LookWalk {
    int level;
    bool at_leaves;
};

/// Announces what the first of `subtrees` read from `coarsest` down to `finest` and, if
/// `at_leaves`, at their leaves. Returns how many subtrees that are; 1 at least, of which not all
/// may be announced if it is more than half of the cache. make() makes a thread's scout:
/// scout(subtree, LookWalk, Wants&). `values`: the cache of the store of vertex values; may be
/// null. Throws what the chunk source throws.
template <class Subtree, class Make>
std::size_t look_ahead(ChunkCache& cache, ChunkCache* values, std::span<const Subtree> subtrees,
                       int coarsest, int finest, bool at_leaves, const Make& make) {
    using Scout = std::invoke_result_t<Make>;
    const std::uint64_t most = cache.budget() / 2;
    const std::uint64_t most_values = values != nullptr ? values->budget() / 2 : 0;
    const std::size_t batch = 4 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
    TraversalNeeds announced;
    std::size_t count = subtrees.size();
    const auto is_full = [&](const TraversalNeeds& fresh, const TraversalNeeds& next) {
        return announced.own.bytes() + fresh.own.bytes() + fresh.own.more_bytes(next.own) > most ||
               announced.values.bytes() + fresh.values.bytes() +
                       fresh.values.more_bytes(next.values) >
                   most_values;
    };
    // Whether there was something to announce.
    const auto walk = [&](const LookWalk& how) {
        TraversalNeeds fresh;
        tbb::enumerable_thread_specific<Scout> scouts(make);
        for (std::size_t first = 0; first < count; first += batch) {
            std::vector<Wants> wants(std::min(batch, count - first), Wants(announced));
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
        cache.announce(fresh.own.chunks());
        if (values != nullptr) {
            values->announce(fresh.values.chunks());
        }
        announced.add(fresh);
        return true;
    };
    for (int level = coarsest; level >= finest; --level) {
        walk({level, false});
    }
    while (at_leaves && walk({finest - 1, true})) {
    }
    return count;
}

}  // namespace isonest::detail
