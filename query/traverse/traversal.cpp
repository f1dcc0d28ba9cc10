#include "query/traverse/traversal.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <memory>

#include "query/traverse/bricks/traverse_finest.h"
#include "query/traverse/bricks/traverse_levels.h"
#include "query/traverse/hexahedra/traverse_hexahedra.h"
#include "store/base/memory.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMinPart = 4096;
constexpr std::size_t kMaxPart = 65536;
constexpr std::uint64_t kReserve = 4U << 20U;  ///< per thread, for memory that is not counted

std::uint64_t decode_heap_of(const StoreReader& store) {
    return decode_heap(largest_chunk_bytes(store.layout()));
}

/// Memory that one thread needs.
struct Needs {
    std::uint64_t chunks;        ///< chunks held from the store
    std::uint64_t value_chunks;  ///< chunks held from the store of vertex values
    std::uint64_t all;
};

Needs needs_of(const StoreReader& store, const TraversalQuery& query, const StoreReader* values,
               std::uint64_t isovalues) {
    const StoreLayout& layout = store.layout();
    // The sampling of attributes and crossings holds its own chunks for each isovalue.
    const bool holds = query.attributes.width() > 0 || query.vertices == VertexPlace::exact;
    Needs needs{(holds ? isovalues : 1) * chunk_heap(layout, query, values != nullptr),
                values != nullptr ? isovalues * attribute_heap(values->layout()) : 0, 0};
    const std::uint64_t decode =
        std::max(decode_heap_of(store), values != nullptr ? decode_heap_of(*values) : 0);
    // While a part is being finished, it exists twice.
    needs.all = needs.chunks + needs.value_chunks + decode +
                isovalues * (list_heap(layout) + table_heap(layout) +
                             2 * kMinPart * LocalMesh::kBytesPerVertex);
    return needs;
}

}  // namespace

std::uint64_t min_heap(const StoreReader& store, const TraversalQuery& query,
                       const StoreReader* values) {
    return needs_of(store, query, values, 1).all;
}

TraversalBudget share_memory(const StoreReader& store, const TraversalQuery& query,
                             const StoreReader* values, const MemoryShare& memory, bool keep_parts,
                             std::uint64_t isovalues) {
    const auto [chunks, value_chunks, each] = needs_of(store, query, values, isovalues);
    const int threads = memory.threads_of(each, "this store's chunks");
    const std::uint64_t usable = memory.left();

    TraversalBudget budget;
    budget.threads = threads;
    const auto count = static_cast<std::uint64_t>(budget.threads);
    const std::uint64_t meshes = count * isovalues;
    std::uint64_t spare = usable - count * each;
    budget.part_vertices = std::clamp<std::size_t>(
        spare / 4 / meshes / (2 * LocalMesh::kBytesPerVertex), kMinPart, kMaxPart);
    spare -= meshes * 2 * (budget.part_vertices - kMinPart) * LocalMesh::kBytesPerVertex;
    spare -= std::min(spare / 8, count * kReserve);
    // With attributes each brick reads all of its neighbours, which costs more than writing the
    // parts to a file.
    budget.parts = !keep_parts ? 0 : query.attributes.width() > 0 ? spare / 8 : spare / 2;
    spare -= budget.parts;
    if (store.is_remote()) {
        budget.waiting = spare / 8;
        spare -= budget.waiting;
    }
    // Held chunks are part of the caches.
    const std::uint64_t values_share = values != nullptr ? spare / 3 : 0;
    budget.values_cache = count * value_chunks + values_share;
    budget.cache = count * chunks + spare - values_share;
    // Chunks that are decoded for their sides are not included in a cache's budget.
    budget.cache -= count * store.layout().array(0, Field::values).chunk_bytes();
    if (values != nullptr) {
        budget.values_cache -= count * values->layout().array(0, Field::values).chunk_bytes();
    }
    return budget;
}

std::uint64_t isovalues_at_once(const StoreReader& store, const TraversalQuery& query,
                                const StoreReader* values, const MemoryShare& memory,
                                std::uint64_t wanted) {
    const auto count = static_cast<std::uint64_t>(memory.threads());
    std::uint64_t most = wanted;
    while (most > 1 &&
           kLibraryHeap + count * needs_of(store, query, values, most).all > memory.bytes() / 2) {
        --most;
    }
    return std::max<std::uint64_t>(most, 1);
}

int chunk_level(const StoreLayout& layout) {
    return std::countr_zero(static_cast<std::uint64_t>(layout.header().chunk));
}

TraversalRun::TraversalRun(ChunkCache& with, const TraversalQuery& asked, std::size_t vertices,
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

TraversalCounts TraversalRun::total() const {
    TraversalCounts total;
    for (const TraversalCounts& c : counts) {
        total.add(c);
    }
    for (const AttributeSampler& sampler : attributes) {
        total.value_rounding.add(sampler.value_rounding());
    }
    return total;
}

void TraversalRun::leave(int level, const Int3& brick) {
    if (query.attributes.width() > 0) {
        if (level > 0) {
            return;
        }
        const ArrayInfo& values = layout().array(0, Field::values);
        cache.keep_sides(values, brick);
        if (query.attribute_values != nullptr) {
            const ArrayInfo& other =
                query.attribute_values->source().layout().array(0, Field::values);
            if (other.grid == values.grid) {
                query.attribute_values->keep_sides(other, brick);
            }
        }
        return;
    }
    const auto keep = [&](int of_level, Field field) {
        // At full resolution nothing stops, and the field may be missing in the store.
        if (layout().has(field)) {
            cache.keep_sides(layout().array(of_level, field), brick);
        }
    };
    keep(level, Field::values);
    if (level < layout().lattice().top()) {
        keep(level + 1, query.stop);
        keep(level + 1, query.bound);
        if (query.culling) {
            keep(level + 1, query.culling->field());
        }
    }
}

namespace {

constexpr std::uint64_t kWholeProgress = std::uint64_t{1} << 40U;

}  // namespace

TraversalCounts traverse(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                         const PartSink& sink, Progress& progress) {
    return traverse_isovalues(cache, query, {&query.iso, 1}, part_vertices, {&sink, 1}, progress)
        .front();
}

std::vector<TraversalCounts> traverse_isovalues(ChunkCache& cache, const TraversalQuery& query,
                                                std::span<const double> isovalues,
                                                std::size_t part_vertices,
                                                std::span<const PartSink> sinks,
                                                Progress& progress) {
    std::vector<TraversalQuery> queries(isovalues.size(), query);
    std::vector<std::unique_ptr<TraversalRun>> runs;
    for (std::size_t i = 0; i < queries.size(); ++i) {
        queries[i].iso = isovalues[i];
        runs.push_back(
            std::make_unique<TraversalRun>(cache, queries[i], part_vertices, sinks[i], progress));
    }
    std::vector<TraversalCounts> counts;
    const bool finest = is_finest(cache.source().layout(), query);
    if (query.cells == Cells::hexahedra && !finest) {
        std::transform(runs.begin(), runs.end(), std::back_inserter(counts),
                       [](const auto& run) { return traverse_hexahedra(*run); });
        return counts;
    }
    progress.begin("extract", kWholeProgress, "");
    if (query.share.is_empty()) {
        progress.advance(kWholeProgress);
    } else if (finest) {
        traverse_finest(runs, kWholeProgress);
    } else {
        traverse_levels(runs, kWholeProgress);
    }
    std::transform(runs.begin(), runs.end(), std::back_inserter(counts),
                   [](const auto& run) { return run->total(); });
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
    // One chunk is decoded for its sides.
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
        heap += NodeSampler::kMaxValueChunks * values * (values_too ? 2 : 1);
    }
    if (query.vertices == VertexPlace::exact) {
        heap += FinestCrossing::max_chunks(layout.lattice().top() + 1) * values;
    }
    if (query.attributes.error) {
        heap += NodeSampler::kMaxIndicatorChunks * largest_chunk(layout, *query.attributes.error);
    }
    return heap;
}

std::uint64_t attribute_heap(const StoreLayout& layout) {
    return (NodeSampler::kMaxValueChunks + 1) * largest_chunk(layout, Field::values);
}

}  // namespace isonest::detail
