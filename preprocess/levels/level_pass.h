// The two kinds of block of the bottom-up pass: the one that takes in the volume and makes levels 0
// to 2, and the one that makes a coarser level from the store being written.
#pragma once

#include <vector>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/sources/plane_window.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Shared by all blocks; read-only while they run, but for `centres` (disjoint boxes).
struct PassContext {
    const StoreLayout& layout;
    CentreStore& centres;
};

/// Number of base blocks per axis; block c covers nodes 2K c to 2K (c + 1) - 1, K being the chunk.
Int3 base_grid(const StoreLayout& layout);
/// Planes of the volume that the blocks with this z need: [first, second).
std::pair<std::int64_t, std::int64_t> base_planes(const StoreLayout& layout, std::int64_t z);
/// Levels 0 to 2 of one base block: values of 0 and 1, indicators of 1 and 2.
template <class T>
std::vector<EncodedChunk> base_block(const PassContext& context, const PlaneWindow& window,
                                     const Int3& block);

/// Number of blocks per axis of the pass that makes level `level` >= 3.
Int3 level_grid(const StoreLayout& layout, int level);
/// Values of level - 1 and indicators of `level`; reads values of level - 2 through `cache`.
template <class T>
std::vector<EncodedChunk> level_block_of(const PassContext& context, ChunkCache& cache, int level,
                                         const Int3& block);

/// The values of the coarsest level, from those of the level below.
template <class T>
std::vector<EncodedChunk> top_values(const PassContext& context, ChunkCache& cache);

/// Heap that one block takes at most, in bytes.
std::uint64_t block_heap(const StoreLayout& layout);

}  // namespace isonest::detail
