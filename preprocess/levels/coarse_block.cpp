#include "preprocess/levels/coarse_block.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/levels/carried_level.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/value_chunks.h"
#include "store/base/box.h"
#include "store/container/gather.h"
#include "store/container/indicator_code.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

auto chunks_of(FinerLevels& finer, const ArrayInfo& array) {
    return [&](const Int3& chunk) { return finer.chunk(array, chunk); };
}

/// The deviations of level 1's cubes as they were stored (rounded up); NaN outside of the volume.
void gather_finest_deviation(FinerLevels& finer, const StoreLayout& layout, Box<float>& box) {
    const ArrayInfo& array = layout.array(1, deviation_carried(layout));
    const Int3 cells = layout.lattice().elements_at(1);
    std::fill(box.data.begin(), box.data.end(), std::numeric_limits<float>::quiet_NaN());
    const Int3 lo = max(box.lo, {0, 0, 0});
    const Int3 size = max(min(box.lo + box.size, cells) - lo, {0, 0, 0});
    if (size.product() == 0) {
        return;
    }
    const auto copy = [&](auto from) {
        gather_from(chunks_of(finer, array), array, from);
        for (std::int64_t z = from.lo.z; z < from.lo.z + from.size.z; ++z) {
            for (std::int64_t y = from.lo.y; y < from.lo.y + from.size.y; ++y) {
                float* const to = box.row(y, z) + (from.lo.x - box.lo.x);
                const auto* const row = from.row(y, z);
                for (std::int64_t x = 0; x < from.size.x; ++x) {
                    to[x] = decode_indicator(row[x]);
                }
            }
        }
    };
    if (layout.header().exact) {
        copy(Box<float>(lo, size));
    } else {
        copy(Box<IndicatorCode>(lo, size));
    }
}

}  // namespace

Int3 coarse_grid(const StoreLayout& layout, int level) {
    Int3 grid = layout.array(level - 1, Field::values).grid;
    for (const ArrayInfo& array : layout.arrays()) {
        if (array.level == level && array.field != Field::values) {
            grid = max(grid, array.grid);
        }
    }
    return grid;
}

template <class T>
ValueBox<T> coarse_values(const StoreLayout& layout, FinerLevels& finer, int level,
                          const Int3& first, const Int3& count) {
    const LayerRange range = range_of(layout, level, first, count);
    const Int3 margin{kCoarseMargin, kCoarseMargin, kCoarseMargin};
    ValueBox<T> box;
    box.values =
        Box<T>(range.lo * 4 - margin, (range.hi - range.lo) * 4 + margin * 2 + Int3{1, 1, 1});
    const ArrayInfo& values = layout.array(level - 2, Field::values);
    gather_from(chunks_of(finer, values), values, box.values);
    box.find_missing();
    return box;
}

template <class T>
void coarse_indicators(const PassContext& context, FinerLevels& finer, int level, const Int3& first,
                       const Int3& count, const ValueBox<T>& box, LevelSink& sink) {
    const StoreLayout& layout = context.layout;
    const Int3 one{1, 1, 1};
    const LayerRange range = range_of(layout, level, first, count);
    LevelTask<T> task = level_task(layout, level, range, box);
    std::vector<Box<float>> centres(
        layout.header().fields.size(),
        Box<float>(range.lo * 2 - one, (range.hi - range.lo) * 2 + one * 2));
    for (std::size_t f = 0; f < centres.size(); ++f) {
        const Field field = layout.header().fields[f];
        context.centres.get(level - 1, field, 0.0F, centres[f]);
        task.fields.push_back({field, &centres[f]});
    }
    Box<float> fine;
    if (task.wants(Indicator::deviation)) {
        fine = Box<float>(box.values.lo, box.values.size);
        if (level == 3) {
            gather_finest_deviation(finer, layout, fine);
        } else {
            context.centres.get(level - 2, deviation_carried(layout),
                                std::numeric_limits<float>::quiet_NaN(), fine);
        }
        task.fine_deviation = &fine;
    }
    run_and_carry(context, task, level, count, sink);
}

template <class T>
std::vector<EncodedChunk> coarse_block(const PassContext& context, FinerLevels& finer, int level,
                                       const Int3& block) {
    const StoreLayout& layout = context.layout;
    const std::int64_t half = layout.header().chunk / 2;
    const Int3 one{1, 1, 1};
    const ValueBox<T> box = coarse_values<T>(layout, finer, level, block * half, one * half);
    std::vector<EncodedChunk> out;
    encode_all_values(&layout.array(level - 1, Field::values), block, one, box.values, 2, out);
    LevelSink sink(layout, level, block, one);
    coarse_indicators(context, finer, level, block * half, one * half, box, sink);
    sink.encode(out);
    return out;
}

template <class T>
std::vector<EncodedChunk> top_values(const PassContext& context, FinerLevels& finer) {
    const StoreLayout& layout = context.layout;
    const int top = layout.lattice().top();
    const ArrayInfo& array = layout.array(top, Field::values);
    Box<T> box({0, 0, 0}, (array.nodes - Int3{1, 1, 1}) * 2 + Int3{1, 1, 1});
    const ArrayInfo& below = layout.array(top - 1, Field::values);
    gather_from(chunks_of(finer, below), below, box);
    std::vector<EncodedChunk> out;
    encode_all_values(&array, {0, 0, 0}, array.grid, box, 2, out);
    return out;
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T)                                                           \
    template ValueBox<T> coarse_values<T>(const StoreLayout&, FinerLevels&, int, const Int3&, \
                                          const Int3&);                                       \
    template void coarse_indicators<T>(const PassContext&, FinerLevels&, int, const Int3&,    \
                                       const Int3&, const ValueBox<T>&, LevelSink&);          \
    template std::vector<EncodedChunk> coarse_block<T>(const PassContext&, FinerLevels&, int, \
                                                       const Int3&);                          \
    template std::vector<EncodedChunk> top_values<T>(const PassContext&, FinerLevels&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

}  // namespace isonest::detail
