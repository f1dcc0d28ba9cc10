#include "query/traversal.h"

#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>

#include "query/brick_work.h"

namespace isonest {
namespace {

constexpr std::uint64_t kWholeProgress = std::uint64_t{1} << 40U;

template <class T>
void run_brick(Shared& shared, int level, const Int3& brick, std::unique_ptr<MaskList> parents,
               std::uint64_t progress_share) {
    shared.progress.check();
    std::array<std::unique_ptr<MaskList>, 8> children;
    int count = 0;
    {
        BrickWork<T> work(shared, level, brick);
        if (parents != nullptr) {
            work.refine_parents(*parents);
        } else {
            work.root();
        }
        parents.reset();
        for (int octant = 0; octant < 8; ++octant) {
            children[static_cast<std::size_t>(octant)] = work.take_children(octant);
            count += children[static_cast<std::size_t>(octant)] != nullptr ? 1 : 0;
        }
    }
    if (count == 0) {
        shared.progress.advance(progress_share);
        return;
    }
    const ArrayInfo& values = shared.cache.source().layout().array(level - 1, Field::values);
    for (int octant = 0; octant < 8; ++octant) {
        if (children[static_cast<std::size_t>(octant)] != nullptr) {
            shared.cache.source().prefetch(
                values, brick * 2 + Int3{octant & 1, (octant >> 1) & 1, octant >> 2});
        }
    }
    tbb::task_group group;
    const std::uint64_t share = progress_share / static_cast<std::uint64_t>(count);
    shared.progress.advance(progress_share - share * static_cast<std::uint64_t>(count));
    for (int octant = 7; octant >= 0; --octant) {
        auto& list = children[static_cast<std::size_t>(octant)];
        if (list == nullptr) {
            continue;
        }
        const Int3 child = brick * 2 + Int3{octant & 1, (octant >> 1) & 1, octant >> 2};
        group.run(
            [&shared, level, child, share, masks = std::shared_ptr<MaskList>(std::move(list))] {
                run_brick<T>(shared, level - 1, child,
                             std::make_unique<MaskList>(std::move(*masks)), share);
            });
    }
    group.wait();
}

}  // namespace

TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress) {
    Shared shared{cache,
                  query,
                  part_vertices,
                  sink,
                  progress,
                  Target(query.iso, query.plane),
                  tbb::enumerable_thread_specific<AttributeSampler>([&] {
                      return AttributeSampler(query.attributes, cache, query.attribute_values);
                  }),
                  tbb::enumerable_thread_specific<LocalMesh>([&] {
                      return LocalMesh(&shared.attributes.local(), query.plane.has_value());
                  }),
                  {}};
    const StoreLayout& layout = cache.source().layout();
    progress.begin("extract", kWholeProgress, "");
    dispatch(layout.header().type, [&](auto tag) {
        run_brick<typename decltype(tag)::type>(shared, layout.lattice().top(), {0, 0, 0}, nullptr,
                                                kWholeProgress);
    });
    TraversalCounts total;
    for (const TraversalCounts& c : shared.counts) {
        total.add(c);
    }
    return total;
}

std::array<double, 3> bound_scale(Field bound, int level, const Double3& spacing) {
    if (indicator_of(bound) != Indicator::grad_linf) {
        return {1, 1, 1};
    }
    // U - U^l is 0 in an element's vertices, and changes by at most the gradient's bound along the
    // way to any other point; none is further than the longest edge of the element's box.
    const double edge = std::ldexp(std::hypot(spacing[0], spacing[1], spacing[2]), level);
    return {edge, 2 * edge, 2 * edge};
}

std::uint64_t brick_heap(const StoreLayout& layout, const TraversalQuery& query) {
    std::uint64_t heap = 8 * layout.array(0, Field::values).chunk_bytes();
    const auto k = static_cast<std::uint64_t>(layout.header().chunk);
    heap += 9 * k * k * k / 8;
    if (layout.lattice().top() > 0) {
        // Up to 2 x 2 x 2 chunks of the parents' and of the centres' array for each field.
        std::vector<Field> fields{query.bound};
        if (query.stop != query.bound) {
            fields.push_back(query.stop);
        }
        if (query.culling) {
            fields.push_back(query.culling->field());
        }
        for (const Field field : fields) {
            heap += 16 * layout.array(1, field).chunk_bytes();
        }
    }
    return heap;
}

}  // namespace isonest
