// AdaptTraverse, out of core: from the coarsest cube to the leaves, brick by brick.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2, 4 and 6. The unit is a cube with a mask of
// its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of values.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <vector>

#include "query/local_mesh.h"
#include "store/chunk_cache.h"
#include "store/progress.h"

namespace isonest {

/// What to extract, in lattice terms.
struct TraversalQuery {
    double iso = 0;
    double epsilon = 0;  ///< refine while the stop field >= epsilon; 0: to the end
    Field stop = Field::deviation_bar;
    Field bound = Field::deviation_bar;  ///< REQUIRES: a sound bound (linf_plus or deviation_bar)
    ClipBox box;                         ///< inside the volume
};

struct TraversalCounts {
    std::uint64_t visited = 0;
    std::uint64_t leaves = 0;
    std::uint64_t bricks = 0;
    double error_bound = 0;
};

/// Receives finished parts; called from many threads. `order` sorts the parts of a mesh.
using PartSink = std::function<void(std::uint64_t order, const MeshPart& part)>;

/// Visits all tetrahedra that may hold the isosurface. `part_vertices` bounds the size of a part.
/// Throws what the chunk source throws, and Error{cancelled}.
TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress);

/// Heap of chunks that one thread may hold at the same time while it works on a brick.
std::uint64_t brick_heap(const StoreLayout& layout, const TraversalQuery& query);

}  // namespace isonest
