#include "query/traverse/brick_tree.h"

#include <algorithm>
#include <bit>

#include "query/traverse/bricks/facing_brick.h"
#include "query/traverse/bricks/finest_brick.h"
#include "query/traverse/hexahedra/finest_hexahedra.h"

namespace isonest::detail {

bool is_split(const StoreLayout& layout, int level) {
    constexpr std::int64_t kFewBricks = 64;
    return layout.array(level, Field::values).grid.product() < kFewBricks;
}

int chunk_level(const StoreLayout& layout) {
    return std::countr_zero(static_cast<std::uint64_t>(layout.header().chunk));
}

bool count_whole(Runs runs, const ParentsOfRuns& parents) {
    const auto half = static_cast<std::size_t>(runs.front()->layout().header().chunk / 2);
    bool is_whole = false;
    for (std::size_t r = 0; r < parents.size(); ++r) {
        if (parents[r] != nullptr && parents[r]->masks.size() == half * half * half) {
            ++runs[r]->counts.local().bricks;
            is_whole = true;
        }
    }
    return is_whole;
}

HandedDown eighths_of(ParentsOfRuns parents) {
    HandedDown eighths;
    for (std::size_t i = 0; i < 8; ++i) {
        eighths.octants[i].resize(parents.size());
        for (std::size_t r = 0; r < parents.size(); ++r) {
            if (parents[r] == nullptr) {
                continue;
            }
            const std::size_t size = parents[r]->masks.size() / 8;
            const auto first = parents[r]->masks.begin() + static_cast<std::ptrdiff_t>(i * size);
            const auto last = first + static_cast<std::ptrdiff_t>(size);
            if (std::any_of(first, last, [](std::uint8_t mask) { return mask != 0; })) {
                eighths.octants[i][r] =
                    std::make_unique<Parents>(Parents{MaskList(first, last), i * size});
                eighths.active.set(i);
            }
        }
    }
    return eighths;
}

void leave_brick(TraversalRun& run, int level, const Int3& brick) {
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

bool is_reached(const TraversalRun& run, const Int3& brick) {
    return may_hold_surface(run.cache.source(), brick, run.query.iso, run.query.box);
}

bool is_seen(TraversalRun& run, const Int3& brick) {
    const TraversalQuery& query = run.query;
    TraversalCounts& counts = run.counts.local();
    const std::uint64_t visited = counts.visited;
    const bool is_seen = !query.culling || may_face_viewer(run, brick);
    if (!query.share.owns(chunk_level(run.layout()), brick)) {
        counts.visited = visited;
    }
    return is_seen;
}

void march_finest(TraversalRun& run, const Int3& brick) {
    const TraversalQuery& query = run.query;
    const auto cubes = surface_cubes(run.cache, brick, query.iso, query.box);
    if (cubes == nullptr) {
        return;
    }
    run.counts.local().bricks += query.share.owns(chunk_level(run.layout()), brick) ? 1 : 0;
    if (query.cells == Cells::hexahedra) {
        march_finest_hexahedra(run, brick, *cubes);
    } else {
        march_finest_brick(run, brick, *cubes);
    }
}

}  // namespace isonest::detail
