// One call of traverse(): what its bricks and threads have in common.
#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cstdint>

#include "query/traverse/traversal.h"

namespace isonest::detail {

/// Cells per axis of the blocks of a brick whose vertices lie in one table (PointTable).
inline std::int64_t table_cells(const StoreLayout& layout) {
    constexpr std::int64_t kMostCells = 32;
    return std::min<std::int64_t>(layout.header().chunk, kMostCells);
}

/// Thread-safety: the members made for each thread are, by local(); the others do not change.
struct TraversalRun {
    TraversalRun(ChunkCache& with, const TraversalQuery& asked, std::size_t vertices,
                 const PartSink& to, Progress& reports)
        : cache(with),
          query(asked),
          part_vertices(vertices),
          sink(to),
          progress(reports),
          attributes(
              [this] { return AttributeSampler(query.attributes, cache, query.attribute_values); }),
          crossings([this] { return FinestCrossing(cache, query.iso); }),
          meshes([this] {
              return query.box.close
                         ? LocalMesh(&attributes.local(), query.box)
                         : LocalMesh(
                               &attributes.local(), query.plane.has_value(),
                               query.vertices == VertexPlace::exact ? &crossings.local() : nullptr);
          }) {}

    [[nodiscard]] const StoreLayout& layout() const { return cache.source().layout(); }

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

}  // namespace isonest::detail
