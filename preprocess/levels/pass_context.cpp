#include "preprocess/levels/pass_context.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/levels/write_positions.h"
#include "store/base/memory.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

/// The minimum size of window and cache.
constexpr std::uint64_t kMinWindow = 6U << 20U;

constexpr std::uint64_t cube(std::uint64_t n) {
    return n * n * n;
}

}  // namespace

BlockHeap block_heap(const StoreLayout& layout) {
    const StoreHeader& header = layout.header();
    const auto k = static_cast<std::uint64_t>(header.chunk);
    const std::uint64_t value = size_of(header.type);
    const std::uint64_t code = header.exact ? 4 : 2;
    const std::uint64_t fields = header.fields.size();
    const std::uint64_t box = cube(2 * k + 2 * kMargin + 1);
    const std::uint64_t chunk = cube(k);
    // For a base block: 2 x 2 x 2 chunks of level 1 and one of level 2, each half as long as those
    // of values.
    std::uint64_t indicators = 0;
    for (const Field field : header.fields) {
        indicators += chunk * (centre_suffices_at_level_1(field) ? 1 : kSlots) + chunk / 8 * kSlots;
    }
    constexpr std::uint64_t kRawAndEncoded = 2;
    constexpr std::uint64_t kLayersPerField = 2;
    constexpr std::uint64_t kPlanes = 24;
    constexpr std::uint64_t kReal = sizeof(double);
    BlockHeap heap;
    heap.values = box * value;
    // 2 x 2 x 2 chunks and that of level 1, encoded, and one raw.
    heap.beside_values = std::max((8 + 1 + 1) * chunk * value, box * sizeof(float));
    heap.indicator_chunks = indicators * code * kRawAndEncoded;
    heap.centres = fields * sizeof(float) * cube(k + 2);
    heap.layers = fields * kLayersPerField * kSlots * kReal * (k + 4) * (k + 4);
    const auto own = static_cast<std::uint64_t>(
        std::count_if(header.fields.begin(), header.fields.end(), is_own));
    if (own > 0) {
        heap.layers +=
            own / 2 * kSlots * kReal * (k + 4) * (k + 4) + DiamondBatch::heap(k + 4, k + 4);
    }
    heap.planes = kPlanes * kReal * (2 * k + 16) * (2 * k + 16);
    heap.codec = codec_heap(chunk * value, header.compression);
    return heap;
}

std::uint64_t PassBudget::cache(std::uint64_t window) const {
    return std::max<std::uint64_t>(rest - std::min(rest, window), kMinWindow);
}

PassBudget share_memory(const StoreLayout& layout, const VolumeSource& source,
                        const PreprocessOptions& options, int threads) {
    PassBudget budget;
    const std::uint64_t block = block_heap(layout).total();
    budget.fixed = kLibraryHeap + source.heap();
    const NodePositionsPtr positions = source.describe().curved;
    const std::uint64_t least = std::max(
        block + kMinWindow, positions ? position_heap(*positions, layout) : std::uint64_t{0});
    require_memory(source.describe().name, options.memory, budget.fixed + least,
                   fmt::format("chunks of {}", options.chunk), {{RemedyKind::smaller_chunk}});
    const std::uint64_t fitting = (options.memory - budget.fixed) * 3 / 5 / block;
    budget.tokens = static_cast<int>(
        std::clamp<std::uint64_t>(fitting, 1, static_cast<std::uint64_t>(threads) + 1));
    budget.blocks = static_cast<std::uint64_t>(budget.tokens) * block;
    budget.rest = options.memory - std::min(options.memory, budget.fixed + budget.blocks);
    return budget;
}

const ArrayInfo* find_array(const StoreLayout& layout, int level, Field field) {
    return level <= layout.lattice().top() && layout.has(field) ? &layout.array(level, field)
                                                                : nullptr;
}

LayerRange range_of(const StoreLayout& layout, int level, const Int3& first, const Int3& count) {
    const Int3 cells = layout.lattice().cells_at(level);
    return {first, min(first + count, cells), cells};
}

Field deviation_carried(const StoreLayout& layout) {
    return layout.has(Field::deviation_bar) ? Field::deviation_bar : Field::deviation_plus;
}

std::vector<Field> fields_at(const StoreLayout& layout, int level) {
    std::vector<Field> fields = layout.header().fields;
    if (level == 1) {
        std::transform(fields.begin(), fields.end(), fields.begin(), source_at_level_1);
        std::sort(fields.begin(), fields.end());
        fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    }
    return fields;
}

}  // namespace isonest::detail
