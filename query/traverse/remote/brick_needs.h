// Which chunks a brick will need, determined from the cubes that it is to refine, before any of
// them is loaded.
#pragma once

#include <cstdint>

#include "query/traverse/bricks/finest_brick.h"
#include "query/traverse/traversal.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Chunks of the store, and of the store from which vertex values are taken.
struct TraversalNeeds {
    ChunkNeeds own;
    ChunkNeeds values;

    void add(const TraversalNeeds& others) {
        own.add(others.own);
        values.add(others.values);
    }
};

/// Prefetches the chunks from both sources.
void prefetch(TraversalRun& run, const TraversalNeeds& needs);

/// Adds what a brick (or the eighth that has lists) needs to find its leaves and subcubes: values
/// and the fields of bound, stop test and culling, including the neighbours that its last cubes
/// use; and what normals, values and errors of vertices may need if leaves are anywhere in these
/// cubes. This is more than needed if the surface does not pass through a cube after all, or stops
/// in it before its subcubes. The needs of exact vertices depend on the values and are not
/// included.
void add_brick_needs(Runs runs, int level, const Int3& brick, const ParentsOfRuns& parents,
                     TraversalNeeds& needs);

/// Whether further needs can be determined once the brick's values are loaded: the normal of a
/// vertex at a node comes from the finest level.
bool has_node_needs(const TraversalRun& run, int level);
/// Adds those needs: the surroundings of nodes whose value is the isovalue. Decodes the brick's
/// values. Thread-safe. Throws what the chunk source throws.
void add_node_needs(Runs runs, int level, const Int3& brick, const ParentsOfRuns& parents,
                    TraversalNeeds& needs);

/// Limits of add_top_needs(), decoded bytes. Remote stores: less than what is transferred during a
/// round trip. Local files: less than what the system reads around a missing page.
inline constexpr std::uint64_t kTopBytesFar = 512U << 10U;
inline constexpr std::uint64_t kTopBytesNear = 4U << 20U;
/// Adds the needs of the coarsest levels (those of one chunk of values), from the top down, as long
/// as they are small.
void add_top_needs(Runs runs, std::uint64_t max_bytes, TraversalNeeds& needs);

/// Without a tolerance: adds what a brick of level 0 needs for its cubes of level 1 in `cubes`.
void add_finest_needs(const TraversalRun& run, const Int3& brick, const MaskList& cubes,
                      TraversalNeeds& needs);

}  // namespace isonest::detail
