#include "query/extract/stages/error_stage.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>

#include "query/extract/stages/distance_limits.h"
#include "query/simplify/by_value/simplify_mesh_by_value.h"
#include "query/traverse/traversal_budget.h"
#include "query/view/node_sampler.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// A store's numbers, through its cache.
class StoreGridNumbers : public GridNumbers {
  public:
    StoreGridNumbers(ChunkCache& cache, Field field) : sampler_(cache), field_(field) {}
    double value(const Int3& node, int level) override { return sampler_.value(node, level); }
    double deviation(const Int3& node) override { return sampler_.grid_indicator(node, field_); }
    void rest() override { sampler_.leave(); }

  private:
    NodeSampler sampler_;
    Field field_;
};

/// Heap of the chunks that one thread holds while it looks at a block: one of values and one of the
/// field at each level. On top of that as many of values as meet at a corner: with fewer in the
/// cache they are decoded over and over.
std::uint64_t held_heap(const StoreReader& store, Field field) {
    std::uint64_t heap = 8 * store.layout().array(0, Field::values).chunk_bytes();
    for (const ArrayInfo& array : store.layout().arrays()) {
        if (array.field == Field::values || array.field == field) {
            heap += array.chunk_bytes();
        }
    }
    return heap;
}

/// Heap that one thread needs outside of the cache.
std::uint64_t own_heap(const StoreReader& store) {
    return simplify_by_value_heap() + decode_heap(largest_chunk_bytes(store.layout()));
}

}  // namespace

int ErrorStage::threads() const {
    const auto& [volume, query, options, scratch, progress] = setting();
    const StoreReader& store = *volume.store;
    const std::uint64_t each = own_heap(store) + held_heap(store, query.traversal.stop);
    // The traversal comes before, and needs other memory.
    const std::uint64_t least = std::max(each, least_heap(store, query.traversal, query.values));
    require_memory(store.path().string(), options.memory, kLibraryHeap + least,
                   "simplification within an error");
    return static_cast<int>(
        std::min((options.memory - kLibraryHeap) / each,
                 static_cast<std::uint64_t>(Workers::count_of(options.threads))));
}

void ErrorStage::run(StageMesh& mesh, ExtractReport& report) {
    const auto& [volume, query, options, scratch, progress] = setting();
    const StoreReader& store = *volume.store;
    const auto threads = static_cast<std::uint64_t>(tbb::this_task_arena::max_concurrency());
    // What is held lies in the cache.
    ChunkCache cache(store, options.memory - kLibraryHeap - threads * own_heap(store));
    const ValueLimit limit{query.traversal.iso, *query.stages.error,
                           [&cache, field = query.traversal.stop] {
                               return std::make_unique<StoreGridNumbers>(cache, field);
                           },
                           query.traversal.box.close.has_value()};
    const auto simplified = std::make_shared<SimplifiedByValue>(
        mesh.vertices(), mesh.elements(), world_lattice(store, query), world_box(query), limit,
        scratch, progress);
    mesh.choose(simplified->corners(), simplified);
    report.simplified_error = ErrorSimplificationReport{mesh.vertices().layout().elements};
    report.error_bound = std::max(report.error_bound, simplified->largest());
}

}  // namespace isonest::detail
