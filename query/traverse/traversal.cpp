#include "query/traverse/traversal.h"

#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <bit>
#include <bitset>
#include <cmath>
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

/// Brick: a BrickTraversal.
template <class Brick>
void run_brick(TraversalRun& run, int level, const Int3& brick, std::unique_ptr<Parents> parents,
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
void run_eighths(TraversalRun& run, int level, const Int3& brick, std::unique_ptr<Parents> parents,
                 std::uint64_t progress_share) {
    std::array<std::unique_ptr<Parents>, 8> eighths;
    std::bitset<8> active;
    const std::size_t size = parents->masks.size() / 8;
    for (std::size_t i = 0; i < 8; ++i) {
        const auto first = parents->masks.begin() + static_cast<std::ptrdiff_t>(i * size);
        const auto last = first + static_cast<std::ptrdiff_t>(size);
        active[i] = std::any_of(first, last, [](std::uint8_t mask) { return mask != 0; });
        if (active[i]) {
            eighths[i] = std::make_unique<Parents>(Parents{MaskList(first, last), i * size});
        }
    }
    parents.reset();
    run_octants(run, active, progress_share, [&](std::size_t i, std::uint64_t share) {
        run_brick<Brick>(run, level, brick, std::move(eighths[i]), share);
    });
}

template <class Brick>
void run_brick(TraversalRun& run, int level, const Int3& brick, std::unique_ptr<Parents> parents,
               std::uint64_t progress_share) {
    run.progress.check();
    const StoreLayout& layout = run.layout();
    const auto half = static_cast<std::size_t>(layout.header().chunk / 2);
    if (parents != nullptr && parents->masks.size() == half * half * half) {
        ++run.counts.local().bricks;
        if (is_split(layout, level)) {
            run_eighths<Brick>(run, level, brick, std::move(parents), progress_share);
            return;
        }
    }
    std::array<std::unique_ptr<MaskList>, 8> children;
    std::bitset<8> active;
    const auto child_of = [&](std::size_t octant) {
        return brick * 2 + kOctants.unlinear(static_cast<std::int64_t>(octant));
    };
    {
        Brick work(run, level, brick);
        if (parents != nullptr) {
            work.refine_parents(parents->masks, parents->begin);
        } else {
            work.root();
        }
        parents.reset();
        for (std::size_t octant = 0; octant < 8; ++octant) {
            children[octant] = work.take_children(octant);
            active[octant] = children[octant] != nullptr;
        }
    }
    if (!is_split(layout, level)) {
        leave(run, level, brick);
    }
    for (std::size_t octant = 0; octant < 8; ++octant) {
        if (active[octant]) {
            run.cache.source().prefetch(layout.array(level - 1, Field::values), child_of(octant));
        }
    }
    run_octants(run, active, progress_share, [&](std::size_t octant, std::uint64_t share) {
        auto masks = std::make_unique<Parents>(Parents{std::move(*children[octant]), 0});
        run_brick<Brick>(run, level - 1, child_of(octant), std::move(masks), share);
    });
}

/// Without a tolerance: the bricks of level 0 among the `size`^3 from `first` on, in Morton order.
void run_finest_bricks(TraversalRun& run, const Int3& first, std::int64_t size,
                       std::uint64_t progress_share) {
    run.progress.check();
    if (size == 1) {
        const bool is_seen = !run.query.culling || may_face_viewer(run, first);
        const auto cubes =
            is_seen ? surface_cubes(run.cache, first, run.query.iso, run.query.box) : nullptr;
        if (cubes != nullptr) {
            ++run.counts.local().bricks;
            if (run.query.cells == Cells::hexahedra) {
                march_finest_hexahedra(run, first, *cubes);
            } else {
                march_finest_brick(run, first, *cubes);
            }
        }
        leave(run, 0, first);
        run.progress.advance(progress_share);
        return;
    }
    const ChunkSource& source = run.cache.source();
    const ArrayInfo& values = source.layout().array(0, Field::values);
    const std::int64_t chunk = source.layout().header().chunk;
    const std::int64_t half = size / 2;
    const auto child_of = [&](std::size_t octant) {
        return first + kOctants.unlinear(static_cast<std::int64_t>(octant)) * half;
    };
    std::bitset<8> active;
    for (std::size_t octant = 0; octant < 8; ++octant) {
        const Int3 child = child_of(octant);
        const Int3 low = child * chunk;
        active[octant] =
            max(child + Int3{1, 1, 1}, values.grid) == values.grid &&
            overlap_of(run.query.box, low, low + Int3{chunk, chunk, chunk} * half) !=
                Overlap::outside &&
            (half > 1 || may_hold_surface(source, child, run.query.iso, run.query.box));
        if (active[octant] && half == 1 && !run.query.culling) {
            source.prefetch(values, child);
        }
    }
    run_octants(run, active, progress_share, [&](std::size_t octant, std::uint64_t share) {
        run_finest_bricks(run, child_of(octant), half, share);
    });
}

/// Whether every node refines: then nothing of the coarser levels is needed.
bool is_finest(const StoreLayout& layout, const TraversalQuery& query) {
    return query.tolerance.is_zero() && !query.plane && layout.lattice().cells_at(0).product() > 0;
}

}  // namespace

TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress) {
    if (query.cells == Cells::hexahedra && !is_finest(cache.source().layout(), query)) {
        return traverse_hexahedra(cache, query, part_vertices, sink, progress);
    }
    TraversalRun run(cache, query, part_vertices, sink, progress);
    const StoreLayout& layout = run.layout();
    progress.begin("extract", kWholeProgress, "");
    if (is_finest(layout, query)) {
        const Int3 grid = layout.array(0, Field::values).grid;
        const auto size = static_cast<std::uint64_t>(std::max({grid.x, grid.y, grid.z}));
        run_finest_bricks(run, {0, 0, 0}, static_cast<std::int64_t>(std::bit_ceil(size)),
                          kWholeProgress);
    } else if (query.plane) {
        run_brick<BrickTraversal<PlaneByDistance>>(run, layout.lattice().top(), {0, 0, 0}, nullptr,
                                                   kWholeProgress);
    } else {
        run_brick<BrickTraversal<IsovalueByBound>>(run, layout.lattice().top(), {0, 0, 0}, nullptr,
                                                   kWholeProgress);
    }
    TraversalCounts total;
    for (const TraversalCounts& c : run.counts) {
        total.add(c);
    }
    for (const AttributeSampler& sampler : run.attributes) {
        total.value_rounding = std::max(total.value_rounding, sampler.value_rounding());
    }
    return total;
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
