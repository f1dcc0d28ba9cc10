#include "query/traverse/bricks/traverse_levels.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "query/traverse/bricks/brick_traversal.h"
#include "query/traverse/remote/brick_needs.h"
#include "query/traverse/remote/look_ahead.h"

namespace isonest::detail {
namespace {

/// A brick, or an eighth of one, with the lists of its cubes.
struct WaitingBrick {
    Int3 brick;
    ParentsOfRuns parents;
};
/// Bricks of one level, in Morton order.
using Wave = std::vector<WaitingBrick>;

/// The tree of bricks, in one of two orders. In both, most bricks come after those whose values
/// they use: the last of eight, or of a window, in Morton order comes first.
///
/// Depth first: a brick's children become tasks as soon as it is done.
///
/// Level by level, for a remote store. Depth first, the need for a chunk is known only when its
/// parent is done, and each generation of bricks in each subtree waits for its own round trip. Here
/// the bricks of a level wait until all of them are known; their needs are prefetched together,
/// then they are processed. Waiting lists of cubes need memory: (K / 2)^3 bytes for a brick and an
/// isovalue. So a wave is divided into windows in Morton order, each of which is processed down to
/// level 0 before the next one starts: breadth first within a window, depth first between windows.
/// A window is as large as two limits allow, and has at least one brick:
///
/// * The lists that its children can get, eight for each brick, use at most an even share of the
///   rest of TraversalQuery::waiting_lists for the levels below. If that is less than eight lists
///   for each level, windows are single bricks, and the waiting lists are those that the tasks of a
///   depth-first traversal hold.
/// * The chunks that it is known to need use, decoded, at most half of the cache. The cache drops
///   the least recently used chunk, so none of them is dropped before use; the other half is for
///   chunks held by threads, and for chunks that windows of coarser levels use again.
///
/// Brick: a BrickTraversal.
template <class Brick>
class LevelTraversal {
  public:
    explicit LevelTraversal(Runs runs) : runs_(runs), run_(*runs.front()), layout_(run_.layout()) {}

    void traverse(std::uint64_t progress_share) {
        const bool is_remote = run_.cache.source().is_remote();
        // For a local store this reads what is not in the page cache at once instead of page by
        // page.
        TraversalNeeds top;
        add_top_needs(runs_, is_remote ? kTopBytesFar : kTopBytesNear, top);
        prefetch(run_, top);
        const int top_level = layout_.lattice().top();
        if (!is_remote) {
            return depth_first(top_level, {{0, 0, 0}, {}}, progress_share);
        }
        if (run_.query.vertices == VertexPlace::exact) {
            rehearsal_.emplace(runs_);
            max_bricks_.assign(static_cast<std::size_t>(top_level) + 1,
                               std::numeric_limits<std::size_t>::max());
        }
        Wave root;
        root.push_back({{0, 0, 0}, {}});
        level_by_level(top_level, std::move(root), progress_share);
    }

  private:
    void depth_first(int level, WaitingBrick waiting, std::uint64_t progress_share) {
        run_.progress.check();
        Wave children = refine(level, std::move(waiting));
        for (std::size_t i = 0; i < children.size(); ++i) {
            if (i == 0 || !(children[i].brick == children[i - 1].brick)) {
                run_.cache.source().prefetch(layout_.array(level - 1, Field::values),
                                             children[i].brick);
            }
        }
        visit_parts(run_.progress, std::move(children), progress_share,
                    [this, level](WaitingBrick child, std::uint64_t share) {
                        depth_first(level - 1, std::move(child), share);
                    });
    }

    /// Processes a brick, or an eighth of one, and frees its lists as they are done. Returns the
    /// bricks to which it passes lists.
    Wave refine(int level, WaitingBrick waiting) {
        std::array<ParentsOfRuns, 8> octants;
        const int child_level = level - 1 + chunk_level(layout_);
        for (std::size_t r = 0; r < runs_.size(); ++r) {
            const bool is_root = waiting.parents.empty();
            if (!is_root && waiting.parents[r] == nullptr) {
                continue;
            }
            Brick work(*runs_[r], level, waiting.brick);
            if (is_root) {
                work.root();
            } else {
                work.refine_parents(waiting.parents[r]->masks, waiting.parents[r]->begin);
                waiting.parents[r].reset();
            }
            for (std::size_t octant = 0; octant < 8; ++octant) {
                auto masks = work.take_children(octant);
                if (masks && run_.query.share.meets(child_level, child_of(waiting.brick, octant))) {
                    octants[octant].resize(runs_.size());
                    octants[octant][r] = std::make_unique<Parents>(Parents{std::move(*masks), 0});
                }
            }
        }
        if (!is_split(level)) {
            run_.leave(level, waiting.brick);
        }
        Wave children;
        for (std::size_t octant = 0; octant < 8; ++octant) {
            if (!octants[octant].empty()) {
                add(level - 1, {child_of(waiting.brick, octant), std::move(octants[octant])},
                    children);
            }
        }
        return children;
    }

    /// The coarsest levels have too few bricks for all threads: there the eighths of a brick are
    /// processed separately.
    [[nodiscard]] bool is_split(int level) const {
        constexpr std::int64_t kFewBricks = 64;
        return layout_.array(level, Field::values).grid.product() < kFewBricks;
    }
    /// Adds a whole brick, or its eighths whose lists are not empty.
    void add(int level, WaitingBrick brick, Wave& wave) {
        for (std::size_t r = 0; r < runs_.size(); ++r) {
            runs_[r]->counts.local().bricks += brick.parents[r] != nullptr ? 1 : 0;
        }
        if (!is_split(level)) {
            wave.push_back(std::move(brick));
            return;
        }
        for (std::size_t i = 0; i < 8; ++i) {
            WaitingBrick eighth{brick.brick, ParentsOfRuns(runs_.size())};
            bool is_empty = true;
            for (std::size_t r = 0; r < runs_.size(); ++r) {
                if (brick.parents[r] == nullptr) {
                    continue;
                }
                const MaskList& masks = brick.parents[r]->masks;
                const std::size_t size = masks.size() / 8;
                const auto first = masks.begin() + static_cast<std::ptrdiff_t>(i * size);
                const auto last = first + static_cast<std::ptrdiff_t>(size);
                if (std::any_of(first, last, [](std::uint8_t mask) { return mask != 0; })) {
                    eighth.parents[r] =
                        std::make_unique<Parents>(Parents{MaskList(first, last), i * size});
                    is_empty = false;
                }
            }
            if (!is_empty) {
                wave.push_back(std::move(eighth));
            }
        }
    }

    void level_by_level(int level, Wave wave, std::uint64_t progress_share) {
        while (!wave.empty()) {
            std::size_t first = begin_of_window(level, wave);
            if (rehearsal_ && level > 0) {
                const std::size_t begin =
                    std::max(first, wave.size() - std::min(wave.size(), max_bricks(level)));
                first = prefetch_crossings(level, wave, begin);
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
                prefetch_nodes(level, window);
            }
            Wave next = work_on(level, std::move(window));
            if (next.empty()) {
                run_.progress.advance(share);
            } else {
                level_by_level(level - 1, std::move(next), share);
            }
        }
    }

    /// Prefetches the needs of the window at the wave's end. Returns the window's start.
    std::size_t begin_of_window(int level, const Wave& wave) {
        const std::uint64_t max_chunks = run_.cache.budget() / 2;
        const std::uint64_t max_values =
            run_.query.attribute_values != nullptr ? run_.query.attribute_values->budget() / 2 : 0;
        const std::uint64_t limit = run_.query.waiting_lists;
        const std::uint64_t max_lists =
            (limit - std::min(limit, waiting_)) / static_cast<std::uint64_t>(std::max(level, 1));
        const std::uint64_t each = level == 0 ? 0 : 8 * heap_of_list() * runs_.size();
        TraversalNeeds needs;
        std::uint64_t lists = 0;
        std::size_t first = wave.size();
        while (first > 0 && (wave.size() - first) / kAhead < max_bricks(level)) {
            TraversalNeeds next;
            add_brick_needs(runs_, level, wave[first - 1].brick, wave[first - 1].parents, next);
            lists += each;
            const bool fits =
                lists + needs.own.heap() + needs.values.heap() <= max_lists &&
                needs.own.bytes() + needs.own.more_bytes(next.own) <= max_chunks &&
                needs.values.bytes() + needs.values.more_bytes(next.values) <= max_values;
            if (!fits && first < wave.size()) {
                break;
            }
            needs.add(next);
            --first;
        }
        prefetch(run_, needs);
        return first;
    }

    /// Also prefetches where the exact vertices of its leaves may be, for as many of its last
    /// bricks as fit. Returns the window's start.
    std::size_t prefetch_crossings(int level, const Wave& wave, std::size_t first) {
        const std::uint64_t most = run_.cache.budget() / 4;
        TraversalNeeds prefetched;
        for (;;) {
            std::vector<Wants> wants(wave.size() - first, Wants(prefetched));
            from_last(wants.size(), [&](std::size_t i) {
                run_.progress.check();
                const WaitingBrick& waiting = wave[first + i];
                (*rehearsal_)(level, waiting.brick, waiting.parents, wants[i]);
            });
            TraversalNeeds fresh;
            for (std::size_t i = wants.size(); i > 0; --i) {
                const TraversalNeeds& found = wants[i - 1].found();
                if (i < wants.size() &&
                    prefetched.own.bytes() + fresh.own.bytes() + fresh.own.more_bytes(found.own) >
                        most) {
                    first += i;
                    break;
                }
                fresh.add(found);
            }
            if (fresh.own.chunks().empty()) {
                return first;
            }
            prefetch(run_, fresh);
            prefetched.add(fresh);
        }
    }

    /// The bricks' own needs are prefetched for this many times as many bricks as are rehearsed.
    static constexpr std::size_t kAhead = 8;
    /// Maximum number of bricks in a level's next window, if they are rehearsed.
    [[nodiscard]] std::size_t max_bricks(int level) const {
        return max_bricks_.empty() ? std::numeric_limits<std::size_t>::max()
                                   : max_bricks_[static_cast<std::size_t>(level)];
    }
    /// Rehearsing bricks that do not fit into the window is wasted: so the next window has at most
    /// twice as many bricks as were left in this one, and later ones twice as many as fitted last.
    void note_window(int level, std::size_t rehearsed, std::size_t left) {
        std::size_t& most = max_bricks_[static_cast<std::size_t>(level)];
        if (left < rehearsed) {
            most = 2 * left;
        } else if (rehearsed == most) {
            most *= 2;
        }
    }

    /// Prefetches what follows from the bricks' values.
    void prefetch_nodes(int level, const Wave& window) {
        std::vector<TraversalNeeds> needs(window.size());
        from_last(window.size(), [&](std::size_t i) {
            add_node_needs(runs_, level, window[i].brick, window[i].parents, needs[i]);
        });
        TraversalNeeds all;
        for (std::size_t i = window.size(); i > 0; --i) {
            all.add(needs[i - 1]);
        }
        prefetch(run_, all);
    }

    /// Processes a window. Returns the bricks of the level below to which it passes lists.
    Wave work_on(int level, Wave window) {
        std::vector<Wave> down(window.size());
        const std::uint64_t own = lists_in(window);
        from_last(window.size(), [&](std::size_t i) {
            run_.progress.check();
            down[i] = refine(level, std::move(window[i]));
        });
        waiting_ -= own;
        Wave next;
        for (Wave& children : down) {
            std::move(children.begin(), children.end(), std::back_inserter(next));
        }
        waiting_ += lists_in(next);
        return next;
    }

    /// For a brick and an isovalue.
    [[nodiscard]] std::uint64_t heap_of_list() const {
        constexpr std::uint64_t kOverhead = 96;
        const auto half = static_cast<std::uint64_t>(layout_.header().chunk / 2);
        return half * half * half + kOverhead;
    }
    /// Approximate heap of the lists of these bricks; those of eighths count as whole ones.
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
    std::optional<CrossingRehearsal<Brick>> rehearsal_;  ///< for exact vertices
    std::vector<std::size_t> max_bricks_;                ///< by level, with rehearsals
    std::uint64_t waiting_ = 0;                          ///< bytes of lists in all waves
};

}  // namespace

void traverse_levels(Runs runs, std::uint64_t progress_share) {
    if (runs.front()->query.plane) {
        LevelTraversal<BrickTraversal<PlaneByDistance>>(runs).traverse(progress_share);
    } else {
        LevelTraversal<BrickTraversal<IsovalueByBound>>(runs).traverse(progress_share);
    }
}

}  // namespace isonest::detail
