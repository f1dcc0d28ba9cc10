// AdaptTraverse, out of core: from the coarsest cube to the leaves, brick by brick.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 5. The unit is a cube with a mask of
// its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of values.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/march/local_mesh.h"
#include "query/traverse/cube_share.h"
#include "query/traverse/culling.h"
#include "query/traverse/lattice_plane.h"
#include "query/traverse/tolerance.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// A tetrahedron that is marched.
struct Leaf {
    int level;                      ///< of the values at its corners
    std::array<Corner, 4> corners;  ///< nodes of the finest lattice
};

/// What to extract, in lattice terms.
struct TraversalQuery {
    double iso = 0;
    std::optional<LatticePlane> plane;              ///< a slice in place of the isosurface
    Tolerance tolerance{0, {}, {}, {1, 1, 1}, {}};  ///< which nodes stop
    Field stop = Field::deviation_bar;
    Field bound = Field::deviation_bar;  ///< REQUIRES: is_bound(bound)
    std::optional<Culling> culling;
    /// Of vertices on edges. REQUIRES: linear if there is a plane, or the box is to be closed.
    VertexPlace vertices = VertexPlace::linear;
    /// REQUIRES: tetrahedra if there is culling, on_leaf, a closed box, or a tolerance that varies.
    Cells cells = Cells::tetrahedra;
    AttributeChoice attributes;
    ChunkCache* attribute_values = nullptr;  ///< another store of the same nodes; null: this one
    ClipBox box;                             ///< inside the volume
    CubeShare share;                         ///< what of it this process traverses
    /// Heap that lists of cubes may take that wait until what they need is announced, where the
    /// store is far (far/waves.h); with less than list_heap() for each level it is what a traversal
    /// depth first takes.
    std::uint64_t waiting_lists = 0;
    /// If set, called for every leaf, from many threads: for programs that measure.
    std::function<void(const Leaf&)> on_leaf;
};

struct TraversalCounts {
    std::uint64_t visited = 0;
    std::uint64_t leaves = 0;
    std::uint64_t bricks = 0;
    double error_bound = 0;
    ValueRounding value_rounding;
    double height_rounding = 0;  ///< of a graph, in its units

    void add(const TraversalCounts& other) {
        visited += other.visited;
        leaves += other.leaves;
        bricks += other.bricks;
        error_bound = std::max(error_bound, other.error_bound);
        value_rounding.add(other.value_rounding);
        height_rounding = std::max(height_rounding, other.height_rounding);
    }
};

/// Receives finished parts; called from many threads. `order` sorts the parts of a mesh.
using PartSink = std::function<void(std::uint64_t order, const MeshPart& part)>;

/// Visits all tetrahedra that may hold the isosurface. `part_vertices` bounds the size of a part.
/// Throws what the chunk source throws, and Error{cancelled}.
TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress);

/// The same of several isovalues in place of query.iso, each with a sink of its own; the counts are
/// in their order. Each brick's chunks are decoded once for all of them. REQUIRES: no plane, as
/// many sinks as isovalues.
std::vector<TraversalCounts> traverse_isovalues(ChunkCache& cache, const TraversalQuery& query,
                                                std::span<const double> isovalues,
                                                std::size_t part_vertices,
                                                std::span<const PartSink> sinks,
                                                Progress& progress);

/// Heap of the table in which a thread finds the vertices of a brick (PointTable).
std::uint64_t table_heap(const StoreLayout& layout);

/// Heap of the lists of cubes that one thread hands down.
std::uint64_t list_heap(const StoreLayout& layout);

/// Heap of chunks that one thread may hold at the same time while it works on a brick.
/// `values_elsewhere`: whether vertex values are taken from another store.
std::uint64_t chunk_heap(const StoreLayout& layout, const TraversalQuery& query,
                         bool values_elsewhere);

/// The same in a store from which it takes TraversalQuery::attribute_values.
std::uint64_t attribute_heap(const StoreLayout& layout);

}  // namespace isonest::detail
