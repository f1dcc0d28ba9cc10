// An indicator's nodal values in a box of the finest lattice.
#pragma once

#include "query/view/blocks.h"
#include "store/base/box.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Sets the field at the refinement nodes in `box` that belong to `level` or a coarser one; leaves
/// the other nodes as they are. The box may reach beyond the volume, where elements do. Throws what
/// ChunkCache throws, and Error{not_found} if the store lacks the field.
void fill_indicators(ChunkCache& cache, Field field, int level, Box<double>& box);

/// Heap of fill_indicators() for a box of kBlockEdge^3 nodes beside the chunks that are decoded,
/// the box included.
inline constexpr std::uint64_t kIndicatorBoxHeap =
    2 * sizeof(double) * (kBlockEdge + 3) * (kBlockEdge + 3) * (kBlockEdge + 3);

}  // namespace isonest::detail
