// A traversal by many threads: what is coarse by one of them, the subtrees below by all.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/progress.h>

#include "query/march/clip.h"
#include "query/march/local_mesh.h"
#include "query/traverse/far/given_ahead.h"
#include "query/traverse/traversal.h"

namespace isonest::detail {

/// The parts that one thread makes, subtree by subtree.
class SubtreeParts {
  public:
    /// `part_vertices` bounds the size of a part.
    SubtreeParts(const ClipBox& box, std::size_t part_vertices, const PartSink& sink,
                 Progress& progress)
        : box_(box), part_vertices_(part_vertices), sink_(sink), progress_(progress) {}

    /// The numbers of the parts that follow begin with that of their subtree.
    void begin(std::uint64_t subtree) {
        constexpr unsigned kPartBits = 40;
        parts_ = subtree << kPartBits;
    }
    /// Hands on what there is. Throws what the sink throws, and Error{cancelled}.
    void flush(LocalMesh& mesh) {
        progress_.check();
        if (!mesh.empty()) {
            sink_(parts_++, mesh.finish(box_));
        }
    }
    void flush_if_full(LocalMesh& mesh) {
        if (mesh.size() >= part_vertices_) {
            flush(mesh);
        }
    }

  private:
    ClipBox box_;
    std::size_t part_vertices_;
    const PartSink& sink_;
    Progress& progress_;
    std::uint64_t parts_ = 0;
};

/// Subtree 0, what is coarse, is above(worker, left), which leaves the subtrees that follow, each
/// of them below(worker, subtree). make() makes a thread's worker: its begin(number) and flush()
/// stand around each subtree, its counts() are added up. Where the store is far, ahead(subtrees)
/// announces what the first of them need, and returns how many that are; workers are made anew
/// after it, so that nobody holds chunks meanwhile.
template <class Subtree, class Make, class Above, class Below, class Ahead>
TraversalCounts walk_subtrees(bool is_far, const Make& make, const Above& above, const Below& below,
                              const Ahead& ahead) {
    using Worker = std::invoke_result_t<Make>;
    std::optional<tbb::enumerable_thread_specific<Worker>> workers(std::in_place, make);
    TraversalCounts counts;
    const auto add_counts = [&] {
        for (const Worker& worker : *workers) {
            counts.add(worker.counts());
        }
    };
    const auto in_subtree = [&](std::uint64_t number, const auto& walk) {
        Worker& worker = workers->local();
        worker.begin(number);
        walk(worker);
        worker.flush();
    };
    std::vector<Subtree> left;
    in_subtree(0, [&](Worker& worker) { above(worker, left); });
    GivenAhead given_ahead;
    for (std::size_t first = 0; first < left.size();) {
        std::size_t end = left.size();
        if (is_far) {
            add_counts();
            workers.emplace(make);
            const std::size_t given = given_ahead.of(left.size() - first);
            const std::size_t taken = ahead(std::span<const Subtree>(left).subspan(first, given));
            given_ahead.took(taken, given);
            end = first + taken;
        }
        tbb::parallel_for(first, end, [&](std::size_t i) {
            in_subtree(i + 1, [&](Worker& worker) { below(worker, left[i]); });
        });
        first = end;
    }
    add_counts();
    return counts;
}

}  // namespace isonest::detail
