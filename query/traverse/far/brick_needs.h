// Which chunks a brick will ask for, from the cubes that it is to refine, before any of them is
// there.
#pragma once

#include <cstdint>

#include "query/traverse/brick_tree.h"
#include "store/container/announce/chunk_needs.h"

namespace isonest::detail {

/// Of the store, and of the one from which vertex values are taken.
struct TraversalNeeds {
    ChunkNeeds own;
    ChunkNeeds values;

    void add(const TraversalNeeds& others) {
        own.add(others.own);
        values.add(others.values);
    }
};

/// Tells the sources of both.
void announce(TraversalRun& run, const TraversalNeeds& needs);

/// What a brick, or the eighth for which there are lists, needs to find its leaves and its
/// subcubes: values, and the fields of bound, stop test and culling, with what its last cubes reach
/// into; and what normals, values and errors of vertices may need if leaves are anywhere in these
/// cubes. It is more than is needed where the surface is found not to pass through a cube after
/// all, or stops in it before its subcubes. What exact vertices need depends on the values, and is
/// not in it.
void add_brick_needs(Runs runs, int level, const Int3& brick, const ParentsOfRuns& parents,
                     TraversalNeeds& needs);

/// Whether there is more to be known when the brick's values are there: a vertex in a node has its
/// normal from the finest level.
bool has_node_needs(const TraversalRun& run, int level);
/// That: what lies around the nodes whose value is the isovalue. Decodes the brick's values.
/// Thread-safe. Throws what the chunk source throws.
void add_node_needs(Runs runs, int level, const Int3& brick, const ParentsOfRuns& parents,
                    TraversalNeeds& needs);

/// Of add_top_needs(), decoded: for a store that is far less than what comes in the time of a round
/// trip, and for a file less than what the system reads beside a page that is missing.
inline constexpr std::uint64_t kTopBytesFar = 512U << 10U;
inline constexpr std::uint64_t kTopBytesNear = 4U << 20U;
/// What the coarsest levels, of one chunk of values each, have of all this, from the top down, as
/// far as it is little.
void add_top_needs(Runs runs, std::uint64_t most_bytes, TraversalNeeds& needs);

/// Without a tolerance: what a brick of level 0 needs for its cubes of level 1 in `cubes`.
void add_finest_needs(const TraversalRun& run, const Int3& brick, const MaskList& cubes,
                      TraversalNeeds& needs);

}  // namespace isonest::detail
