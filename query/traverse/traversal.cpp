#include "query/traverse/traversal.h"

#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <bit>
#include <bitset>
#include <cmath>
#include <iterator>
#include <memory>

#include "query/march/clip.h"
#include "query/traverse/brick_tree.h"
#include "query/traverse/bricks/brick_traversal.h"
#include "query/traverse/far/brick_needs.h"
#include "query/traverse/far/finest_windows.h"
#include "query/traverse/far/waves.h"
#include "query/traverse/hexahedra/traverse_hexahedra.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kWholeProgress = std::uint64_t{1} << 40U;

/// Runs a task visit(octant, share of the progress) for each octant of `active`, the last soonest:
/// so most bricks come after those whose values they reach into.
template <class Visit>
void run_octants(TraversalRun& run, const std::bitset<8>& active, std::uint64_t progress_share,
                 const Visit& visit) {
    const std::uint64_t share = active.none() ? 0 : progress_share / active.count();
    run.progress.advance(progress_share - share * active.count());
    tbb::task_group group;
    for (std::size_t octant = 0; octant < 8; ++octant) {
        if (active[octant]) {
            group.run([&visit, octant, share] { visit(octant, share); });
        }
    }
    group.wait();
}

/// Depth first. Brick: a BrickTraversal.
template <class Brick>
void run_brick(Runs runs, int level, const Int3& brick, ParentsOfRuns parents,
               std::uint64_t progress_share) {
    TraversalRun& common = *runs.front();
    common.progress.check();
    const StoreLayout& layout = common.layout();
    if (count_whole(runs, parents) && is_split(layout, level)) {
        HandedDown eighths = eighths_of(std::move(parents));
        run_octants(common, eighths.active, progress_share,
                    [&](std::size_t i, std::uint64_t share) {
                        run_brick<Brick>(runs, level, brick, std::move(eighths.octants[i]), share);
                    });
        return;
    }
    HandedDown down = refine_brick<Brick>(runs, level, brick, parents);
    if (!is_split(layout, level)) {
        leave_brick(common, level, brick);
    }
    for (std::size_t octant = 0; octant < 8; ++octant) {
        if (down.active[octant]) {
            common.cache.source().prefetch(layout.array(level - 1, Field::values),
                                           child_of(brick, octant));
        }
    }
    run_octants(common, down.active, progress_share, [&](std::size_t octant, std::uint64_t share) {
        run_brick<Brick>(runs, level - 1, child_of(brick, octant), std::move(down.octants[octant]),
                         share);
    });
}

/// Without a tolerance: the bricks of level 0 among the `size`^3 from `first` on, in Morton order.
void run_finest_bricks(Runs runs, const Int3& first, std::int64_t size,
                       std::uint64_t progress_share) {
    TraversalRun& common = *runs.front();
    common.progress.check();
    if (size == 1) {
        for (const auto& run : runs) {
            if ((runs.size() == 1 || is_reached(*run, first)) && is_seen(*run, first)) {
                march_finest(*run, first);
            }
        }
        leave_brick(common, 0, first);
        common.progress.advance(progress_share);
        return;
    }
    const ChunkSource& source = common.cache.source();
    const ArrayInfo& values = source.layout().array(0, Field::values);
    const std::int64_t chunk = source.layout().header().chunk;
    const std::int64_t half = size / 2;
    const int child_level =
        chunk_level(source.layout()) + std::countr_zero(static_cast<std::uint64_t>(half));
    const auto part_of = [&](std::size_t octant) {
        return first + kOctants.unlinear(static_cast<std::int64_t>(octant)) * half;
    };
    std::bitset<8> active;
    for (std::size_t octant = 0; octant < 8; ++octant) {
        const Int3 child = part_of(octant);
        const Int3 low = child * chunk;
        active[octant] = values.has_chunk(child) &&
                         common.query.share.meets(
                             child_level, {child.x / half, child.y / half, child.z / half}) &&
                         overlap_of(common.query.box, low,
                                    low + Int3{chunk, chunk, chunk} * half) != Overlap::outside &&
                         (half > 1 || std::any_of(runs.begin(), runs.end(), [&](const auto& run) {
                              return is_reached(*run, child);
                          }));
        if (active[octant] && half == 1 && !common.query.culling) {
            source.prefetch(values, child);
        }
    }
    run_octants(common, active, progress_share, [&](std::size_t octant, std::uint64_t share) {
        run_finest_bricks(runs, part_of(octant), half, share);
    });
}

/// Whether every node refines: then nothing of the coarser levels is needed.
bool is_finest(const StoreLayout& layout, const TraversalQuery& query) {
    return query.tolerance.is_zero() && !query.plane && layout.lattice().cells_at(0).product() > 0;
}

/// All bricks, in the order that suits the store.
template <class Brick>
void run_bricks(Runs runs) {
    if (runs.front()->cache.source().is_far()) {
        Waves<Brick>(runs).traverse(kWholeProgress);
    } else {
        // What is not in the page cache comes together, and not page by page.
        TraversalNeeds top;
        add_top_needs(runs, kTopBytesNear, top);
        announce(*runs.front(), top);
        run_brick<Brick>(runs, runs.front()->layout().lattice().top(), {0, 0, 0}, {},
                         kWholeProgress);
    }
}

void traverse_bricks(Runs runs) {
    TraversalRun& common = *runs.front();
    const TraversalQuery& query = common.query;
    const StoreLayout& layout = common.layout();
    common.progress.begin("extract", kWholeProgress, "");
    if (query.share.is_empty()) {
        common.progress.advance(kWholeProgress);
        return;
    }
    if (is_finest(layout, query)) {
        if (common.cache.source().is_far()) {
            run_finest_windows(runs, kWholeProgress);
            return;
        }
        const Int3 grid = layout.array(0, Field::values).grid;
        const auto size = static_cast<std::uint64_t>(std::max({grid.x, grid.y, grid.z}));
        run_finest_bricks(runs, {0, 0, 0}, static_cast<std::int64_t>(std::bit_ceil(size)),
                          kWholeProgress);
    } else if (query.plane) {
        run_bricks<BrickTraversal<PlaneByDistance>>(runs);
    } else {
        run_bricks<BrickTraversal<IsovalueByBound>>(runs);
    }
}

TraversalCounts total_of(const TraversalRun& run) {
    TraversalCounts total;
    for (const TraversalCounts& c : run.counts) {
        total.add(c);
    }
    for (const AttributeSampler& sampler : run.attributes) {
        total.value_rounding.add(sampler.value_rounding());
    }
    return total;
}

}  // namespace

TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress) {
    if (query.cells == Cells::hexahedra && !is_finest(cache.source().layout(), query)) {
        return traverse_hexahedra(cache, query, part_vertices, sink, progress);
    }
    const std::unique_ptr<TraversalRun> run =
        std::make_unique<TraversalRun>(cache, query, part_vertices, sink, progress);
    traverse_bricks({&run, 1});
    return total_of(*run);
}

std::vector<TraversalCounts> traverse_isovalues(ChunkCache& cache, const TraversalQuery& query,
                                                std::span<const double> isovalues,
                                                std::size_t part_vertices,
                                                std::span<const PartSink> sinks,
                                                Progress& progress) {
    std::vector<TraversalQuery> queries(isovalues.size(), query);
    std::vector<std::unique_ptr<TraversalRun>> runs;
    std::vector<TraversalCounts> counts;
    const bool is_by_itself =
        query.cells == Cells::hexahedra && !is_finest(cache.source().layout(), query);
    for (std::size_t i = 0; i < queries.size(); ++i) {
        queries[i].iso = isovalues[i];
        if (is_by_itself) {
            counts.push_back(traverse(cache, queries[i], part_vertices, sinks[i], progress));
        } else {
            runs.push_back(std::make_unique<TraversalRun>(cache, queries[i], part_vertices,
                                                          sinks[i], progress));
        }
    }
    if (!is_by_itself) {
        traverse_bricks(runs);
        std::transform(runs.begin(), runs.end(), std::back_inserter(counts),
                       [](const auto& run) { return total_of(*run); });
    }
    return counts;
}

std::uint64_t table_heap(const StoreLayout& layout) {
    return PointTable::bytes(static_cast<std::uint64_t>(table_cells(layout)));
}

namespace {

std::uint64_t largest_chunk(const StoreLayout& layout, Field field) {
    std::uint64_t largest = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        largest = std::max<std::uint64_t>(largest, array.field == field ? array.chunk_bytes() : 0);
    }
    return largest;
}

}  // namespace

std::uint64_t list_heap(const StoreLayout& layout) {
    const auto k = static_cast<std::uint64_t>(layout.header().chunk);
    return 9 * k * k * k / 8;
}

std::uint64_t chunk_heap(const StoreLayout& layout, const TraversalQuery& query,
                         bool values_elsewhere) {
    const std::uint64_t values = largest_chunk(layout, Field::values);
    // One is decoded for its sides.
    std::uint64_t heap = 9 * values;
    std::vector<Field> fields{query.bound};
    if (query.stop != query.bound) {
        fields.push_back(query.stop);
    }
    if (query.culling) {
        fields.push_back(query.culling->field());
    }
    for (const Field field : fields) {
        // Up to 2 x 2 x 2 chunks of the parents' and of the centres' array.
        heap += 16 * largest_chunk(layout, field);
    }
    if (query.attributes.width() > 0) {
        const bool values_too = query.attributes.value && !values_elsewhere;
        heap += NodeSampler::kMostValueChunks * values * (values_too ? 2 : 1);
    }
    if (query.vertices == VertexPlace::exact) {
        heap += FinestCrossing::most_chunks(layout.lattice().top() + 1) * values;
    }
    if (query.attributes.error) {
        heap += NodeSampler::kMostIndicatorChunks * largest_chunk(layout, *query.attributes.error);
    }
    return heap;
}

std::uint64_t attribute_heap(const StoreLayout& layout) {
    return (NodeSampler::kMostValueChunks + 1) * largest_chunk(layout, Field::values);
}

}  // namespace isonest::detail
