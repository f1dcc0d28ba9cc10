// AdaptTraverse, out of core: from the coarsest cube to the leaves, brick by brick.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 5. The unit is a cube with a mask of
// its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of values.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/march/local_mesh.h"
#include "query/traverse/interest.h"
#include "query/values/blocks.h"
#include "query/values/brick_view.h"
#include "store/base/memory.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {

// The share of a traversal that one of several ranks does.
//
// The cells of the finest lattice are in Morton order. A rank has a contiguous range of them, and
// all cubes of any level whose first cell is in it. So consecutive ranges share the work without
// communication, and the border of a range cuts at most one cube of each level.

/// The cells [begin, end). REQUIRES: both are multiples of the number of cells in a cube of level
/// 1.
struct CubeShare {
    /// Greater than any number of cells.
    static constexpr std::uint64_t kEnd = std::uint64_t{1} << 63U;
    std::uint64_t begin = 0;
    std::uint64_t end = kEnd;

    [[nodiscard]] bool is_whole() const { return begin == 0 && end == kEnd; }
    [[nodiscard]] bool is_empty() const { return begin >= end; }
    /// Whether the cube of edge 2^level belongs to this rank. `at`: in cubes of that level.
    [[nodiscard]] bool owns(int level, const Int3& at) const {
        const std::uint64_t first = morton_code(at) << cell_bits(level);
        return begin <= first && first < end;
    }
    /// Whether some of its cells belong to this rank.
    [[nodiscard]] bool meets(int level, const Int3& at) const {
        const std::uint64_t first = morton_code(at) << cell_bits(level);
        return first < end && begin < first + (std::uint64_t{1} << cell_bits(level));
    }
    /// The part of `count` cubes, starting at Morton code `first`, that meets the range: begin and
    /// end, relative to `first`.
    [[nodiscard]] std::pair<std::size_t, std::size_t> meeting(int level, std::uint64_t first,
                                                              std::size_t count) const {
        const std::uint64_t low = begin >> cell_bits(level);
        const std::uint64_t high =
            (end + (std::uint64_t{1} << cell_bits(level)) - 1) >> cell_bits(level);
        const auto within = [&](std::uint64_t code) {
            return static_cast<std::size_t>(
                std::min<std::uint64_t>(code > first ? code - first : 0, count));
        };
        return {within(low), within(high)};
    }

  private:
    /// Bits of a Morton code that select a cell within a cube; limited to all bits for coarser
    /// cubes.
    static constexpr unsigned cell_bits(int level) {
        return std::min(3U * static_cast<unsigned>(level), 63U);
    }
};

/// A tetrahedron that is marched.
struct Leaf {
    int level;                      ///< of the values at its corners
    std::array<Corner, 4> corners;  ///< nodes of the finest lattice
};

/// What to extract, in lattice terms.
struct TraversalQuery {
    double iso = 0;
    std::optional<LatticePlane> plane;       ///< a slice instead of the isosurface
    Tolerance tolerance{0, {}, {}, {}, {}};  ///< determines which nodes stop
    Field stop = Field::deviation_bar;
    Field bound = Field::deviation_bar;  ///< REQUIRES: is_bound(bound)
    std::optional<Culling> culling;
    /// Placement of vertices on edges. REQUIRES: linear if there is a plane or the box is closed.
    VertexPlace vertices = VertexPlace::linear;
    /// REQUIRES: tetrahedra if there is culling, on_leaf, a closed box, or a varying tolerance.
    Cells cells = Cells::tetrahedra;
    AttributeChoice attributes;
    ChunkCache* attribute_values = nullptr;  ///< another store with the same nodes; null: this one
    ClipBox box;                             ///< inside the volume
    CubeShare share;                         ///< the part that this process traverses
    /// Maximum heap for lists of cubes that wait until their data is prefetched, if the store is
    /// remote (bricks/traverse_levels.cpp). If it is less than list_heap() for each level, the
    /// traversal needs what a depth-first traversal needs.
    std::uint64_t waiting_lists = 0;
    /// If set, called for every leaf, from many threads; for measurements.
    std::function<void(const Leaf&)> on_leaf;
};

struct TraversalCounts {
    std::uint64_t visited = 0;
    std::uint64_t leaves = 0;
    std::uint64_t bricks = 0;
    double stopped_at = 0;  ///< largest number of the stop test at which a leaf stopped
    ValueRounding value_rounding;
    double height_rounding = 0;  ///< of a graph, in its units

    void add(const TraversalCounts& other) {
        visited += other.visited;
        leaves += other.leaves;
        bricks += other.bricks;
        stopped_at = std::max(stopped_at, other.stopped_at);
        value_rounding.add(other.value_rounding);
        height_rounding = std::max(height_rounding, other.height_rounding);
    }
};

/// Receives finished parts; called from many threads. The parts of a mesh are sorted by `order`.
using PartSink = std::function<void(std::uint64_t order, MeshPart&& part)>;

/// Visits all tetrahedra that may contain the isosurface. `part_vertices`: limit for the size of a
/// part. Throws what the chunk source throws, and Error{cancelled}.
TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress);

/// The same for several isovalues instead of query.iso, each with its own sink; the counts are in
/// the same order. Each brick's chunks are decoded once for all of them. REQUIRES: no plane; as
/// many sinks as isovalues.
std::vector<TraversalCounts> traverse_isovalues(ChunkCache& cache, const TraversalQuery& query,
                                                std::span<const double> isovalues,
                                                std::size_t part_vertices,
                                                std::span<const PartSink> sinks,
                                                Progress& progress);

/// Heap of the table that a thread uses to find the vertices of a brick (PointTable).
std::uint64_t table_heap(const StoreLayout& layout);

/// Heap of the lists of cubes that one thread passes down.
std::uint64_t list_heap(const StoreLayout& layout);

// Distribution of a traversal's memory.

struct TraversalBudget {
    int threads = 1;
    std::size_t part_vertices = 0;   ///< parameter of traverse()
    std::uint64_t cache = 0;         ///< bytes of the store's ChunkCache
    std::uint64_t values_cache = 0;  ///< bytes of the ChunkCache from which vertex values are
                                     ///< taken, or positions of nodes
    std::uint64_t parts = 0;         ///< bytes for finished parts; 0 unless requested
    std::uint64_t waiting = 0;  ///< TraversalQuery::waiting_lists; 0 unless the store is remote
};

/// What the threads of a traversal need. `isovalues`: the number given to traverse_isovalues().
class TraversalHeap {
  public:
    /// `values`: of another store, from which vertex values are taken, or null (REQUIRES: null for
    /// a curvilinear grid, whose positions are read instead). Both must outlive it.
    TraversalHeap(const StoreLayout& layout, const TraversalQuery& query,
                  const StoreLayout* values = nullptr);

    /// Maximum heap of chunks of the store that one thread holds at the same time while it
    /// processes a brick of one isovalue.
    [[nodiscard]] std::uint64_t chunks() const { return chunks_; }
    /// Heap that one thread needs in addition to kLibraryHeap.
    [[nodiscard]] std::uint64_t thread(std::uint64_t isovalues = 1) const;
    /// For how many isovalues (1 ... `wanted`) the memory suffices at the same time with the
    /// requested number of threads. Half of the memory is reserved for parts and cache.
    [[nodiscard]] std::uint64_t isovalues_at_once(const MemoryShare& memory,
                                                  std::uint64_t wanted) const;
    /// Distributes the memory; if it is too small, fewer threads are used. `is_remote`: the store.
    /// `keep_parts`: whether finished parts are kept. Throws Error{limit} with the minimum memory
    /// required.
    [[nodiscard]] TraversalBudget share(const MemoryShare& memory, bool is_remote, bool keep_parts,
                                        std::uint64_t isovalues = 1) const;

  private:
    /// The sampling of attributes and crossings holds its own chunks for each isovalue.
    [[nodiscard]] std::uint64_t all_chunks(std::uint64_t isovalues) const {
        return (samples_ ? isovalues : 1) * chunks_;
    }

    const StoreLayout& layout_;
    const StoreLayout* values_;
    bool has_attributes_;
    bool samples_;
    std::uint64_t chunks_;
    std::uint64_t value_chunks_ = 0;  ///< of the other store, or of positions
    std::uint64_t value_chunk_ = 0;   ///< one of them that is decoded for its sides
};

// One call of traverse(): state shared by its bricks and threads, and the loops over bricks.

/// Cells per axis of the blocks of a brick that share a vertex table (PointTable).
inline std::int64_t table_cells(const StoreLayout& layout) {
    constexpr std::int64_t kMaxCells = 32;
    return std::min<std::int64_t>(layout.header().chunk, kMaxCells);
}

/// Level of the cubes that have the size of a brick of level 0.
int chunk_level(const StoreLayout& layout);

inline Int3 child_of(const Int3& brick, std::size_t octant) {
    return brick * 2 + kOctants.unlinear(static_cast<std::int64_t>(octant));
}

/// Thread-safety: members made for each thread are accessed by local(); the others do not change.
struct TraversalRun {
    TraversalRun(ChunkCache& with, const TraversalQuery& asked, std::size_t vertices,
                 const PartSink& to, Progress& reports);

    [[nodiscard]] const StoreLayout& layout() const { return cache.source().layout(); }
    /// Whether every node refines; the coarser levels are then not needed.
    [[nodiscard]] bool is_finest() const {
        return query.tolerance.is_zero() && !query.plane &&
               layout().lattice().cells_at(0).product() > 0;
    }
    /// Sum over all threads.
    [[nodiscard]] TraversalCounts total() const;
    /// Marks a brick as done. The bricks before it along each axis, which come later, need only the
    /// first values of it and the first indicators of its parents. Vertex attributes also need the
    /// last ones, and are sampled anywhere in the coarser levels.
    void leave(int level, const Int3& brick);

    ChunkCache& cache;
    const TraversalQuery& query;
    std::size_t part_vertices;
    const PartSink& sink;
    Progress& progress;
    tbb::enumerable_thread_specific<AttributeSampler> attributes;
    tbb::enumerable_thread_specific<FinestCrossing> crossings;
    tbb::enumerable_thread_specific<LocalMesh> meshes;
    tbb::enumerable_thread_specific<TraversalCounts> counts;
};

/// One run per isovalue; they differ in the isovalue, the sink and the results.
using Runs = std::span<const std::unique_ptr<TraversalRun>>;

/// Depth first: starts a task visit(part, share of the progress) for each part of a brick or of a
/// group of bricks. The last ones are started first, so most bricks come after those whose values
/// they use.
template <class Part, class Visit>
void visit_parts(Progress& progress, std::vector<Part> parts, std::uint64_t progress_share,
                 const Visit& visit) {
    const std::uint64_t share = parts.empty() ? 0 : progress_share / parts.size();
    progress.advance(progress_share - share * parts.size());
    tbb::task_group group;
    for (Part& part : parts) {
        group.run([&visit, &part, share] { visit(std::move(part), share); });
    }
    group.wait();
}

/// Processes a window: calls work(i) for i from `count` - 1 down to 0, on all threads of the arena.
template <class Work>
void from_last(std::size_t count, const Work& work) {
    std::atomic<std::size_t> left{count};
    const auto take = [&] {
        while (!tbb::is_current_task_group_canceling()) {
            std::size_t next = left.load();
            while (next > 0 && !left.compare_exchange_weak(next, next - 1)) {
            }
            if (next == 0) {
                return;
            }
            work(next - 1);
        }
    };
    const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
    tbb::task_group group;
    for (std::size_t t = 0; t < std::min(threads, count); ++t) {
        group.run(take);
    }
    group.wait();
}

}  // namespace isonest::detail
