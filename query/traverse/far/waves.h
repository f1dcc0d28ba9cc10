// Bricks level by level, for a store behind a network.
//
// Depth first, a chunk is found to be needed when its parent is done, and each generation of bricks
// in each subtree waits for a round trip of its own. Here the bricks of a level wait until all of
// them are known; what they need is announced together, then they are worked on.
//
// Lists of cubes that wait take memory: (K / 2)^3 bytes for a brick and an isovalue. So a wave is
// cut into windows in Morton order, each of which goes down to level 0 before the next begins:
// breadth first within a window, depth first between them. A window is as large as two limits
// allow, and one brick at least:
//
// * The lists that its children can be given, eight for each brick, take at most an even share of
//   what is left of TraversalQuery::waiting_lists for the levels below. Where that is less than
//   eight lists for each level, the windows are single bricks, and what waits is what the tasks of
//   a traversal depth first hold.
// * The chunks that it is known to need take, decoded, at most half of the cache. The cache drops
//   what was used longest ago, so none of them is dropped before it is used; the other half is for
//   what threads hold, and for what windows of coarser levels come back to.
//
// Within a wave the last brick in Morton order goes first, as depth first: so most bricks come
// after those into which they reach.
#pragma once

#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "query/traverse/far/brick_needs.h"
#include "query/traverse/far/crossing_rehearsal.h"
#include "query/traverse/far/from_last.h"

namespace isonest::detail {

/// A brick, or an eighth of one, with the lists of its cubes.
struct WaitingBrick {
    Int3 brick;
    ParentsOfRuns parents;
};
/// Of one level, in Morton order.
using Wave = std::vector<WaitingBrick>;

/// Brick: a BrickTraversal.
template <class Brick>
class Waves {
  public:
    explicit Waves(Runs runs) : runs_(runs), run_(*runs.front()), layout_(run_.layout()) {
        if (run_.query.vertices == VertexPlace::exact) {
            rehearsal_.emplace(runs);
            most_bricks_.assign(static_cast<std::size_t>(layout_.lattice().top()) + 1,
                                std::numeric_limits<std::size_t>::max());
        }
    }

    /// Throws what the chunk source and the sinks throw, and Error{cancelled}.
    void traverse(std::uint64_t progress_share) {
        TraversalNeeds top;
        add_top_needs(runs_, kTopBytesFar, top);
        announce(run_, top);
        Wave root;
        root.push_back({{0, 0, 0}, {}});
        descend(layout_.lattice().top(), std::move(root), progress_share);
    }

  private:
    void descend(int level, Wave wave, std::uint64_t progress_share) {
        while (!wave.empty()) {
            std::size_t first = begin_of_window(level, wave);
            if (rehearsal_ && level > 0) {
                const std::size_t begin =
                    std::max(first, wave.size() - std::min(wave.size(), most_bricks(level)));
                first = announce_crossings(level, wave, begin);
                note_window(level, wave.size() - begin, wave.size() - first);
            }
            const auto size = static_cast<std::uint64_t>(wave.size() - first);
            const std::uint64_t share =
                first == 0 ? progress_share : progress_share / wave.size() * size;
            progress_share -= share;
            Wave window(std::make_move_iterator(wave.begin() + static_cast<std::ptrdiff_t>(first)),
                        std::make_move_iterator(wave.end()));
            wave.resize(first);
            if (has_node_needs(run_, level)) {
                announce_nodes(level, window);
            }
            Wave next = work_on(level, std::move(window));
            if (next.empty()) {
                run_.progress.advance(share);
            } else {
                descend(level - 1, std::move(next), share);
            }
        }
    }

    /// Announces what the window at the wave's end needs.
    std::size_t begin_of_window(int level, const Wave& wave) {
        const std::uint64_t most_chunks = run_.cache.budget() / 2;
        const std::uint64_t most_values =
            run_.query.attribute_values != nullptr ? run_.query.attribute_values->budget() / 2 : 0;
        const std::uint64_t limit = run_.query.waiting_lists;
        const std::uint64_t most_lists =
            (limit - std::min(limit, waiting_)) / static_cast<std::uint64_t>(std::max(level, 1));
        const std::uint64_t each = level == 0 ? 0 : 8 * heap_of_list() * runs_.size();
        TraversalNeeds needs;
        std::uint64_t lists = 0;
        std::size_t first = wave.size();
        while (first > 0 && (wave.size() - first) / kAhead < most_bricks(level)) {
            TraversalNeeds next;
            add_brick_needs(runs_, level, wave[first - 1].brick, wave[first - 1].parents, next);
            lists += each;
            const bool fits =
                lists + needs.own.heap() + needs.values.heap() <= most_lists &&
                needs.own.bytes() + needs.own.more_bytes(next.own) <= most_chunks &&
                needs.values.bytes() + needs.values.more_bytes(next.values) <= most_values;
            if (!fits && first < wave.size()) {
                break;
            }
            needs.add(next);
            --first;
        }
        announce(run_, needs);
        return first;
    }

    /// And where the exact vertices of its leaves may be, of as many of its last bricks as fit: the
    /// window's begin.
    std::size_t announce_crossings(int level, const Wave& wave, std::size_t first) {
        const std::uint64_t most = run_.cache.budget() / 4;
        TraversalNeeds announced;
        for (;;) {
            std::vector<Wants> wants(wave.size() - first, Wants(announced));
            from_last(wants.size(), [&](std::size_t i) {
                run_.progress.check();
                const WaitingBrick& waiting = wave[first + i];
                (*rehearsal_)(level, waiting.brick, waiting.parents, wants[i]);
            });
            TraversalNeeds fresh;
            for (std::size_t i = wants.size(); i > 0; --i) {
                const TraversalNeeds& found = wants[i - 1].found();
                if (i < wants.size() &&
                    announced.own.bytes() + fresh.own.bytes() + fresh.own.more_bytes(found.own) >
                        most) {
                    first += i;
                    break;
                }
                fresh.add(found);
            }
            if (fresh.own.chunks().empty()) {
                return first;
            }
            announce(run_, fresh);
            announced.add(fresh);
        }
    }

    /// What bricks need themselves is announced for so many times those that are rehearsed.
    static constexpr std::size_t kAhead = 8;
    /// Bricks of a level's next window, where they are rehearsed.
    [[nodiscard]] std::size_t most_bricks(int level) const {
        return most_bricks_.empty() ? std::numeric_limits<std::size_t>::max()
                                    : most_bricks_[static_cast<std::size_t>(level)];
    }
    /// What is cut off a window was rehearsed in vain: so the next one has at most twice as many
    /// bricks as were left of this, and others after it twice as many as fitted last.
    void note_window(int level, std::size_t rehearsed, std::size_t left) {
        std::size_t& most = most_bricks_[static_cast<std::size_t>(level)];
        if (left < rehearsed) {
            most = 2 * left;
        } else if (rehearsed == most) {
            most *= 2;
        }
    }

    /// And what their values say.
    void announce_nodes(int level, const Wave& window) {
        std::vector<TraversalNeeds> needs(window.size());
        from_last(window.size(), [&](std::size_t i) {
            add_node_needs(runs_, level, window[i].brick, window[i].parents, needs[i]);
        });
        TraversalNeeds all;
        for (std::size_t i = window.size(); i > 0; --i) {
            all.add(needs[i - 1]);
        }
        announce(run_, all);
    }

    /// The bricks of the level below that the window hands lists to.
    Wave work_on(int level, Wave window) {
        std::vector<HandedDown> down(window.size());
        const std::uint64_t own = lists_in(window);
        from_last(window.size(), [&](std::size_t i) {
            run_.progress.check();
            WaitingBrick& waiting = window[i];
            down[i] = refine_brick<Brick>(runs_, level, waiting.brick, waiting.parents);
            if (!is_split(layout_, level)) {
                leave_brick(run_, level, waiting.brick);
            }
        });
        waiting_ -= own;
        Wave next;
        for (std::size_t i = 0; i < window.size(); ++i) {
            for (std::size_t octant = 0; octant < 8; ++octant) {
                if (down[i].active[octant]) {
                    add(level - 1, child_of(window[i].brick, octant),
                        std::move(down[i].octants[octant]), next);
                }
            }
        }
        waiting_ += lists_in(next);
        return next;
    }

    void add(int level, const Int3& brick, ParentsOfRuns parents, Wave& wave) {
        if (!count_whole(runs_, parents) || !is_split(layout_, level)) {
            wave.push_back({brick, std::move(parents)});
            return;
        }
        HandedDown eighths = eighths_of(std::move(parents));
        for (std::size_t i = 0; i < 8; ++i) {
            if (eighths.active[i]) {
                wave.push_back({brick, std::move(eighths.octants[i])});
            }
        }
    }

    /// Of a brick and an isovalue.
    [[nodiscard]] std::uint64_t heap_of_list() const {
        constexpr std::uint64_t kOverhead = 96;
        const auto half = static_cast<std::uint64_t>(layout_.header().chunk / 2);
        return half * half * half + kOverhead;
    }
    /// Heap of the lists of these bricks, about; those of eighths count as whole ones.
    [[nodiscard]] std::uint64_t lists_in(const Wave& wave) const {
        std::uint64_t lists = 0;
        for (const WaitingBrick& waiting : wave) {
            lists += static_cast<std::uint64_t>(
                std::count_if(waiting.parents.begin(), waiting.parents.end(),
                              [](const auto& list) { return list != nullptr; }));
        }
        return lists * heap_of_list();
    }

    Runs runs_;
    TraversalRun& run_;
    const StoreLayout& layout_;
    std::optional<CrossingRehearsal<Brick>> rehearsal_;  ///< of exact vertices
    std::vector<std::size_t> most_bricks_;               ///< by level, with rehearsals
    std::uint64_t waiting_ = 0;                          ///< bytes of lists in all waves
};

}  // namespace isonest::detail
