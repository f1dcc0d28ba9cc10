#include "query/traverse/traversal.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <memory>

#include "query/march/curved_place.h"
#include "query/traverse/bricks/traverse_finest.h"
#include "query/traverse/bricks/traverse_levels.h"
#include "query/traverse/hexahedra/traverse_hexahedra.h"
#include "store/base/memory.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMinPart = 4096;
constexpr std::size_t kMaxPart = 65536;
constexpr std::uint64_t kReserve = 4U << 20U;  ///< per thread, for memory that is not counted

std::uint64_t largest_chunk(const StoreLayout& layout, Field field) {
    std::uint64_t largest = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        largest = std::max<std::uint64_t>(largest, array.field == field ? array.chunk_bytes() : 0);
    }
    return largest;
}

}  // namespace

TraversalHeap::TraversalHeap(const StoreLayout& layout, const TraversalQuery& query,
                             const StoreLayout* values)
    : layout_(layout),
      values_(values),
      has_attributes_(query.attributes.width() > 0),
      samples_(has_attributes_ || query.vertices == VertexPlace::exact) {
    const std::uint64_t of_values = largest_chunk(layout, Field::values);
    // One chunk is decoded for its sides.
    chunks_ = 9 * of_values;
    std::vector<Field> fields{query.bound};
    if (query.stop != query.bound) {
        fields.push_back(query.stop);
    }
    if (query.culling) {
        fields.push_back(query.culling->field());
    }
    for (const Field field : fields) {
        // Up to 2 x 2 x 2 chunks of the parents' and of the centres' array.
        chunks_ += 16 * largest_chunk(layout, field);
    }
    if (has_attributes_) {
        const bool values_too = query.attributes.value && values == nullptr;
        chunks_ += NodeSampler::kMaxValueChunks * of_values * (values_too ? 2 : 1);
    }
    if (query.vertices == VertexPlace::exact) {
        chunks_ += FinestCrossing::max_chunks(layout.lattice().top() + 1) * of_values;
    }
    if (query.attributes.error) {
        chunks_ +=
            NodeSampler::kMaxIndicatorChunks * largest_chunk(layout, *query.attributes.error);
    }
    if (values != nullptr) {
        value_chunk_ = largest_chunk(*values, Field::values);
        value_chunks_ = (NodeSampler::kMaxValueChunks + 1) * value_chunk_;
    } else if (layout.header().curved) {
        value_chunks_ = 3 * CurvedPlace::kMaxHeld * layout.positions()[0].chunk_bytes();
    }
}

std::uint64_t TraversalHeap::thread(std::uint64_t isovalues) const {
    const std::uint64_t decode =
        std::max(decode_heap(largest_chunk_bytes(layout_)),
                 values_ != nullptr ? decode_heap(largest_chunk_bytes(*values_)) : 0);
    // While a part is being finished, it exists twice.
    return all_chunks(isovalues) + decode +
           isovalues * (value_chunks_ + list_heap(layout_) + table_heap(layout_) +
                        2 * kMinPart * LocalMesh::kBytesPerVertex);
}

std::uint64_t TraversalHeap::isovalues_at_once(const MemoryShare& memory,
                                               std::uint64_t wanted) const {
    const auto count = static_cast<std::uint64_t>(memory.threads());
    std::uint64_t most = wanted;
    while (most > 1 && kLibraryHeap + count * thread(most) > memory.bytes() / 2) {
        --most;
    }
    return std::max<std::uint64_t>(most, 1);
}

TraversalBudget TraversalHeap::share(const MemoryShare& memory, bool is_remote, bool keep_parts,
                                     std::uint64_t isovalues) const {
    const std::uint64_t each = thread(isovalues);
    TraversalBudget budget;
    budget.threads = memory.threads_of(each, "this store's chunks");
    const auto count = static_cast<std::uint64_t>(budget.threads);
    const std::uint64_t meshes = count * isovalues;
    std::uint64_t spare = memory.left() - count * each;
    budget.part_vertices = std::clamp<std::size_t>(
        spare / 4 / meshes / (2 * LocalMesh::kBytesPerVertex), kMinPart, kMaxPart);
    spare -= meshes * 2 * (budget.part_vertices - kMinPart) * LocalMesh::kBytesPerVertex;
    spare -= std::min(spare / 8, count * kReserve);
    // With attributes each brick reads all of its neighbours, which costs more than writing the
    // parts to a file.
    budget.parts = !keep_parts ? 0 : has_attributes_ ? spare / 8 : spare / 2;
    spare -= budget.parts;
    if (is_remote) {
        budget.waiting = spare / 8;
        spare -= budget.waiting;
    }
    // Held chunks are part of the caches.
    const std::uint64_t values_share = value_chunks_ > 0 ? spare / 3 : 0;
    budget.values_cache = count * isovalues * value_chunks_ + values_share;
    budget.cache = count * all_chunks(isovalues) + spare - values_share;
    // Chunks that are decoded for their sides are not included in a cache's budget.
    budget.cache -= count * layout_.array(0, Field::values).chunk_bytes();
    budget.values_cache -= count * value_chunk_;
    return budget;
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
    const bool finest = runs.front()->is_finest();
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

std::uint64_t list_heap(const StoreLayout& layout) {
    const auto k = static_cast<std::uint64_t>(layout.header().chunk);
    return 9 * k * k * k / 8;
}

}  // namespace isonest::detail
