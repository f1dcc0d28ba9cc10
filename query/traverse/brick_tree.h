// The tree of bricks: what a brick is given and hands down, whatever the order in which bricks are
// worked on.
#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "query/traverse/bricks/surface_cubes.h"
#include "query/traverse/traversal_run.h"
#include "query/view/field_view.h"

namespace isonest::detail {

/// Cubes of a brick's parent level, or a part of them: those of a range in Morton order.
struct Parents {
    MaskList masks;
    std::size_t begin = 0;
};

/// One for each isovalue: they differ in that, in their sink and in what they find.
using Runs = std::span<const std::unique_ptr<TraversalRun>>;
/// For each run; null where it has nothing here. Empty for the root.
using ParentsOfRuns = std::vector<std::unique_ptr<Parents>>;

/// What goes to each octant of a brick; active where a run has something there.
struct HandedDown {
    std::array<ParentsOfRuns, 8> octants;
    std::bitset<8> active;
};

/// The coarsest levels have fewer bricks than there are threads to feed: there the eighths of a
/// brick are worked on by themselves.
bool is_split(const StoreLayout& layout, int level);

/// Level of the cubes that are as large as a brick of level 0.
int chunk_level(const StoreLayout& layout);

inline Int3 child_of(const Int3& brick, std::size_t octant) {
    return brick * 2 + kOctants.unlinear(static_cast<std::int64_t>(octant));
}

/// Whether the runs have their lists of the whole brick, not of an eighth; it is counted then.
bool count_whole(Runs runs, const ParentsOfRuns& parents);

/// The eighths of a whole brick's lists that are not empty.
HandedDown eighths_of(ParentsOfRuns parents);

/// The brick is done. Those before it along each axis, which come later, need no more of its values
/// and of its parents' indicators than the first ones. Vertex attributes also need the last ones,
/// and are sampled anywhere in the coarser levels.
void leave_brick(TraversalRun& run, int level, const Int3& brick);

/// The work on a brick, or on an eighth of one. Brick: a BrickTraversal. Each run's list is given
/// up when it is done.
template <class Brick>
HandedDown refine_brick(Runs runs, int level, const Int3& brick, ParentsOfRuns& parents) {
    HandedDown down;
    for (ParentsOfRuns& of_octant : down.octants) {
        of_octant.resize(runs.size());
    }
    const bool is_root = parents.empty();
    const int child_level = level - 1 + chunk_level(runs.front()->layout());
    for (std::size_t r = 0; r < runs.size(); ++r) {
        if (!is_root && parents[r] == nullptr) {
            continue;
        }
        Brick work(*runs[r], level, brick);
        if (is_root) {
            work.root();
        } else {
            work.refine_parents(parents[r]->masks, parents[r]->begin);
            parents[r].reset();
        }
        for (std::size_t octant = 0; octant < 8; ++octant) {
            if (auto masks = work.take_children(octant);
                masks && runs.front()->query.share.meets(child_level, child_of(brick, octant))) {
                down.octants[octant][r] = std::make_unique<Parents>(Parents{std::move(*masks), 0});
                down.active.set(octant);
            }
        }
    }
    return down;
}

/// Without a tolerance: whether a run's surface may pass through a brick of level 0, by the chunk
/// table.
bool is_reached(const TraversalRun& run, const Int3& brick);
/// Whether some of it may face the query's viewer, if there is one; what is looked at is counted.
bool is_seen(TraversalRun& run, const Int3& brick);
/// The surface of one run in a brick of level 0.
void march_finest(TraversalRun& run, const Int3& brick);

}  // namespace isonest::detail
