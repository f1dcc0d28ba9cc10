#include "query/traverse/traversal.h"

#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <bit>
#include <bitset>
#include <cmath>
#include <iterator>
#include <memory>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_traversal.h"
#include "query/traverse/bricks/facing_brick.h"
#include "query/traverse/bricks/finest_brick.h"
#include "query/traverse/hexahedra/finest_hexahedra.h"
#include "query/traverse/hexahedra/traverse_hexahedra.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kWholeProgress = std::uint64_t{1} << 40U;

/// Cubes of a brick's parent level, or a part of them: those of a range in Morton order.
struct Parents {
    MaskList masks;
    std::size_t begin = 0;
};

/// The coarsest levels have fewer bricks than there are threads to feed: there the eighths of a
/// brick are worked on by themselves.
bool is_split(const StoreLayout& layout, int level) {
    constexpr std::int64_t kFewBricks = 64;
    return layout.array(level, Field::values).grid.product() < kFewBricks;
}

/// Level of the cubes that are as large as a brick of level 0.
int chunk_level(const StoreLayout& layout) {
    return std::countr_zero(static_cast<std::uint64_t>(layout.header().chunk));
}

/// One for each isovalue: they differ in that, in their sink and in what they find.
using Runs = std::span<const std::unique_ptr<TraversalRun>>;
/// For each run; null where it has nothing here.
using ParentsOfRuns = std::vector<std::unique_ptr<Parents>>;

/// Brick: a BrickTraversal. `parents`: empty for the root.
template <class Brick>
void run_brick(Runs runs, int level, const Int3& brick, ParentsOfRuns parents,
               std::uint64_t progress_share);

/// The brick is done. Those before it along each axis, which come later, need no more of its values
/// and of its parents' indicators than the first ones. Vertex attributes also need the last ones,
/// and are sampled anywhere in the coarser levels.
void leave(TraversalRun& run, int level, const Int3& brick) {
    const TraversalQuery& query = run.query;
    const StoreLayout& layout = run.layout();
    if (query.attributes.width() > 0) {
        if (level > 0) {
            return;
        }
        run.cache.keep_sides(layout.array(0, Field::values), brick);
        if (query.attribute_values != nullptr) {
            const ArrayInfo& other =
                query.attribute_values->source().layout().array(0, Field::values);
            if (other.grid == layout.array(0, Field::values).grid) {
                query.attribute_values->keep_sides(other, brick);
            }
        }
        return;
    }
    const auto keep = [&](int of_level, Field field) {
        // At full resolution nothing stops, and the store need not have the field.
        if (layout.has(field)) {
            run.cache.keep_sides(layout.array(of_level, field), brick);
        }
    };
    keep(level, Field::values);
    if (level < layout.lattice().top()) {
        keep(level + 1, query.stop);
        keep(level + 1, query.bound);
        if (query.culling) {
            keep(level + 1, query.culling->field());
        }
    }
}

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

template <class Brick>
void run_eighths(Runs runs, int level, const Int3& brick, ParentsOfRuns parents,
                 std::uint64_t progress_share) {
    std::array<ParentsOfRuns, 8> eighths;
    std::bitset<8> active;
    for (std::size_t i = 0; i < 8; ++i) {
        eighths[i].resize(runs.size());
        for (std::size_t r = 0; r < runs.size(); ++r) {
            if (parents[r] == nullptr) {
                continue;
            }
            const std::size_t size = parents[r]->masks.size() / 8;
            const auto first = parents[r]->masks.begin() + static_cast<std::ptrdiff_t>(i * size);
            const auto last = first + static_cast<std::ptrdiff_t>(size);
            if (std::any_of(first, last, [](std::uint8_t mask) { return mask != 0; })) {
                eighths[i][r] = std::make_unique<Parents>(Parents{MaskList(first, last), i * size});
                active.set(i);
            }
        }
    }
    parents.clear();
    run_octants(*runs.front(), active, progress_share, [&](std::size_t i, std::uint64_t share) {
        run_brick<Brick>(runs, level, brick, std::move(eighths[i]), share);
    });
}

template <class Brick>
void run_brick(Runs runs, int level, const Int3& brick, ParentsOfRuns parents,
               std::uint64_t progress_share) {
    TraversalRun& common = *runs.front();
    common.progress.check();
    const StoreLayout& layout = common.layout();
    const auto half = static_cast<std::size_t>(layout.header().chunk / 2);
    const bool is_root = parents.empty();
    const auto is_here = [&](std::size_t r) { return is_root || parents[r] != nullptr; };
    bool is_whole = false;
    for (std::size_t r = 0; r < parents.size(); ++r) {
        if (is_here(r) && parents[r]->masks.size() == half * half * half) {
            ++runs[r]->counts.local().bricks;
            is_whole = true;
        }
    }
    if (is_whole && is_split(layout, level)) {
        run_eighths<Brick>(runs, level, brick, std::move(parents), progress_share);
        return;
    }
    std::array<ParentsOfRuns, 8> children;
    std::bitset<8> active;
    const auto child_of = [&](std::size_t octant) {
        return brick * 2 + kOctants.unlinear(static_cast<std::int64_t>(octant));
    };
    for (ParentsOfRuns& of_octant : children) {
        of_octant.resize(runs.size());
    }
    const int child_level = level - 1 + chunk_level(layout);
    for (std::size_t r = 0; r < runs.size(); ++r) {
        if (!is_here(r)) {
            continue;
        }
        Brick work(*runs[r], level, brick);
        if (is_root) {
            work.root();
        } else {
            work.refine_parents(parents[r]->masks, parents[r]->begin);
            parents[r].reset();
        }
        for (std::size_t octant = 0; octant < 8; ++octant) {
            if (auto masks = work.take_children(octant);
                masks && common.query.share.meets(child_level, child_of(octant))) {
                children[octant][r] = std::make_unique<Parents>(Parents{std::move(*masks), 0});
                active.set(octant);
            }
        }
    }
    if (!is_split(layout, level)) {
        leave(common, level, brick);
    }
    for (std::size_t octant = 0; octant < 8; ++octant) {
        if (active[octant]) {
            common.cache.source().prefetch(layout.array(level - 1, Field::values),
                                           child_of(octant));
        }
    }
    run_octants(common, active, progress_share, [&](std::size_t octant, std::uint64_t share) {
        run_brick<Brick>(runs, level - 1, child_of(octant), std::move(children[octant]), share);
    });
}

/// The surface of one run in a brick of level 0.
void march_finest(TraversalRun& run, const Int3& brick) {
    const TraversalQuery& query = run.query;
    TraversalCounts& counts = run.counts.local();
    const std::uint64_t visited = counts.visited;
    const bool is_seen = !query.culling || may_face_viewer(run, brick);
    const bool is_own = query.share.owns(chunk_level(run.layout()), brick);
    counts.visited = is_own ? counts.visited : visited;
    const auto cubes = is_seen ? surface_cubes(run.cache, brick, query.iso, query.box) : nullptr;
    if (cubes == nullptr) {
        return;
    }
    counts.bricks += is_own ? 1 : 0;
    if (query.cells == Cells::hexahedra) {
        march_finest_hexahedra(run, brick, *cubes);
    } else {
        march_finest_brick(run, brick, *cubes);
    }
}

bool is_reached(const TraversalRun& run, const Int3& brick) {
    return may_hold_surface(run.cache.source(), brick, run.query.iso, run.query.box);
}

/// Without a tolerance: the bricks of level 0 among the `size`^3 from `first` on, in Morton order.
void run_finest_bricks(Runs runs, const Int3& first, std::int64_t size,
                       std::uint64_t progress_share) {
    TraversalRun& common = *runs.front();
    common.progress.check();
    if (size == 1) {
        for (const auto& run : runs) {
            if (runs.size() == 1 || is_reached(*run, first)) {
                march_finest(*run, first);
            }
        }
        leave(common, 0, first);
        common.progress.advance(progress_share);
        return;
    }
    const ChunkSource& source = common.cache.source();
    const ArrayInfo& values = source.layout().array(0, Field::values);
    const std::int64_t chunk = source.layout().header().chunk;
    const std::int64_t half = size / 2;
    const int child_level =
        chunk_level(source.layout()) + std::countr_zero(static_cast<std::uint64_t>(half));
    const auto child_of = [&](std::size_t octant) {
        return first + kOctants.unlinear(static_cast<std::int64_t>(octant)) * half;
    };
    std::bitset<8> active;
    for (std::size_t octant = 0; octant < 8; ++octant) {
        const Int3 child = child_of(octant);
        const Int3 low = child * chunk;
        active[octant] = max(child + Int3{1, 1, 1}, values.grid) == values.grid &&
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
        run_finest_bricks(runs, child_of(octant), half, share);
    });
}

/// Whether every node refines: then nothing of the coarser levels is needed.
bool is_finest(const StoreLayout& layout, const TraversalQuery& query) {
    return query.tolerance.is_zero() && !query.plane && layout.lattice().cells_at(0).product() > 0;
}

}  // namespace

namespace {

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
        const Int3 grid = layout.array(0, Field::values).grid;
        const auto size = static_cast<std::uint64_t>(std::max({grid.x, grid.y, grid.z}));
        run_finest_bricks(runs, {0, 0, 0}, static_cast<std::int64_t>(std::bit_ceil(size)),
                          kWholeProgress);
    } else if (query.plane) {
        run_brick<BrickTraversal<PlaneByDistance>>(runs, layout.lattice().top(), {0, 0, 0}, {},
                                                   kWholeProgress);
    } else {
        run_brick<BrickTraversal<IsovalueByBound>>(runs, layout.lattice().top(), {0, 0, 0}, {},
                                                   kWholeProgress);
    }
}

TraversalCounts total_of(const TraversalRun& run) {
    TraversalCounts total;
    for (const TraversalCounts& c : run.counts) {
        total.add(c);
    }
    for (const AttributeSampler& sampler : run.attributes) {
        total.value_rounding = std::max(total.value_rounding, sampler.value_rounding());
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
        largest = std::max(largest, array.field == field ? array.chunk_bytes() : 0);
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
