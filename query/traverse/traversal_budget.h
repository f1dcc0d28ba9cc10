// How a traversal's memory is shared.
#pragma once

#include "query/traverse/traversal.h"
#include "store/container/reader.h"

namespace isonest::detail {

struct TraversalBudget {
    int threads = 1;
    std::size_t part_vertices = 0;   ///< of traverse()
    std::uint64_t cache = 0;         ///< bytes of the store's ChunkCache
    std::uint64_t values_cache = 0;  ///< of that from which vertex values are taken
    std::uint64_t parts = 0;         ///< bytes for finished parts; 0 unless asked for
    std::uint64_t waiting = 0;       ///< TraversalQuery::waiting_lists; 0 unless the store is far
};

/// Heap that one thread needs beside kLibraryHeap. `values`: as below.
std::uint64_t least_heap(const StoreReader& store, const TraversalQuery& query,
                         const StoreReader* values);

/// Shares `memory` bytes of heap; fewer threads than `threads` (0 = all cores) run where there is
/// little. `values`: another store from which vertex values are taken, or null. `keep_parts`:
/// whether finished parts are kept. `isovalues`: how many traverse_isovalues() is given. Throws
/// Error{limit}, naming the least memory, in which `elsewhere` bytes that something else holds are
/// counted.
TraversalBudget share_memory(const StoreReader& store, const TraversalQuery& query,
                             const StoreReader* values, std::uint64_t memory,
                             std::uint64_t elsewhere, int threads, bool keep_parts,
                             std::uint64_t isovalues = 1);

/// Of how many isovalues, at most `wanted`, as many threads as are asked for have memory at a time;
/// at least 1. Half of the memory is left for parts and cache.
std::uint64_t isovalues_at_once(const StoreReader& store, const TraversalQuery& query,
                                const StoreReader* values, std::uint64_t memory, int threads,
                                std::uint64_t wanted);

}  // namespace isonest::detail
