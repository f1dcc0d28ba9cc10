// The nested grid's own triangles within a distance of the full surface: the stop test is the
// distance itself.
#pragma once

#include <cstdint>

#include "query/traverse/traversal.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Heap that one thread needs in addition to that of traverse(), for a query with this bound.
std::uint64_t distance_traversal_heap(const StoreLayout& layout, Field bound);

/// Like traverse() for the query's isosurface, with exact vertices, and leaves whose triangles are
/// within `limit` (world units, > 0) of the surface at full resolution, in both directions.
/// Elements that are cut by the box, and those larger than 32 cells, are always refined. REQUIRES:
/// query.vertices is exact; no culling, no closed box. In the counts, stopped_at is a distance,
/// world units. Throws what traverse() throws, and Error{io}.
TraversalCounts traverse_within_distance(TraversalRun& run, double limit,
                                         const ScratchFolder& folder);

}  // namespace isonest::detail
