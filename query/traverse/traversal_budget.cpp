#include "query/traverse/traversal_budget.h"

#include <algorithm>

#include "store/base/memory_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kLeastPart = 4096;
constexpr std::size_t kMostPart = 65536;
constexpr std::uint64_t kReserve = 4U << 20U;  ///< of a thread, for what is not counted

std::uint64_t decode_heap_of(const StoreReader& store) {
    return decode_heap(largest_chunk_bytes(store.layout()));
}

/// What one thread needs.
struct Needs {
    std::uint64_t chunks;        ///< of the store, held
    std::uint64_t value_chunks;  ///< of the store of vertex values, held
    std::uint64_t all;
};

Needs needs_of(const StoreReader& store, const TraversalQuery& query, const StoreReader* values,
               std::uint64_t isovalues) {
    const StoreLayout& layout = store.layout();
    // What samples attributes and crossings holds chunks of its own for each isovalue.
    const bool holds = query.attributes.width() > 0 || query.vertices == VertexPlace::exact;
    Needs needs{(holds ? isovalues : 1) * chunk_heap(layout, query, values != nullptr),
                values != nullptr ? isovalues * attribute_heap(values->layout()) : 0, 0};
    const std::uint64_t decode =
        std::max(decode_heap_of(store), values != nullptr ? decode_heap_of(*values) : 0);
    // While a part is finished, it is there twice.
    needs.all = needs.chunks + needs.value_chunks + decode +
                isovalues * (list_heap(layout) + table_heap(layout) +
                             2 * kLeastPart * LocalMesh::kBytesPerVertex);
    return needs;
}

}  // namespace

std::uint64_t least_heap(const StoreReader& store, const TraversalQuery& query,
                         const StoreReader* values) {
    return needs_of(store, query, values, 1).all;
}

TraversalBudget share_memory(const StoreReader& store, const TraversalQuery& query,
                             const StoreReader* values, std::uint64_t memory,
                             std::uint64_t elsewhere, int threads, bool keep_parts,
                             std::uint64_t isovalues) {
    const auto [chunks, value_chunks, each] = needs_of(store, query, values, isovalues);
    require_memory(store.path().string(), memory, kLibraryHeap + elsewhere + each,
                   "this store's chunks");
    const std::uint64_t usable = memory - kLibraryHeap - elsewhere;

    TraversalBudget budget;
    budget.threads = static_cast<int>(std::clamp<std::uint64_t>(
        usable / each, 1, static_cast<std::uint64_t>(Workers::count_of(threads))));
    const auto count = static_cast<std::uint64_t>(budget.threads);
    const std::uint64_t meshes = count * isovalues;
    std::uint64_t spare = usable - count * each;
    budget.part_vertices = std::clamp<std::size_t>(
        spare / 4 / meshes / (2 * LocalMesh::kBytesPerVertex), kLeastPart, kMostPart);
    spare -= meshes * 2 * (budget.part_vertices - kLeastPart) * LocalMesh::kBytesPerVertex;
    spare -= std::min(spare / 8, count * kReserve);
    // Attributes make each brick look into all that surround it, which costs more than to write the
    // parts to a file.
    budget.parts = !keep_parts ? 0 : query.attributes.width() > 0 ? spare / 8 : spare / 2;
    spare -= budget.parts;
    if (store.is_far()) {
        budget.waiting = spare / 8;
        spare -= budget.waiting;
    }
    // What is held lies in the caches.
    const std::uint64_t values_share = values != nullptr ? spare / 3 : 0;
    budget.values_cache = count * value_chunks + values_share;
    budget.cache = count * chunks + spare - values_share;
    // Chunks that are decoded for their sides come on top of a cache's budget.
    budget.cache -= count * store.layout().array(0, Field::values).chunk_bytes();
    if (values != nullptr) {
        budget.values_cache -= count * values->layout().array(0, Field::values).chunk_bytes();
    }
    return budget;
}

std::uint64_t isovalues_at_once(const StoreReader& store, const TraversalQuery& query,
                                const StoreReader* values, std::uint64_t memory, int threads,
                                std::uint64_t wanted) {
    const auto count = static_cast<std::uint64_t>(Workers::count_of(threads));
    std::uint64_t most = wanted;
    while (most > 1 &&
           kLibraryHeap + count * needs_of(store, query, values, most).all > memory / 2) {
        --most;
    }
    return std::max<std::uint64_t>(most, 1);
}

}  // namespace isonest::detail
