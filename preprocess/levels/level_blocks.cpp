#include "preprocess/levels/level_blocks.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>
#include <vector>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/value_rows.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "store/base/box.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

/// The cubes of the level inside a block, for the centres that it passes on.
Box<float> own_cubes(const LayerRange& range, const Int3& count) {
    const Int3 end = min(range.lo + count, max(range.cells, {1, 1, 1}));
    return {range.lo, max(end - range.lo, {0, 0, 0})};
}

}  // namespace

template <class T>
void run_and_carry(const PassContext& context, const LevelTask<T>& task, int level,
                   const Int3& count, LevelSink& sink) {
    const bool carry = level < context.layout.lattice().top();
    const int centre = context.layout.lattice().centre_slot();
    std::vector<Box<float>> centres(carry ? task.fields.size() : 0, own_cubes(task.range, count));
    run_level(task, [&](Field field, std::int64_t k, const auto& layer) {
        sink.put(field, task.range, k, layer);
        for (std::size_t f = 0; f < centres.size(); ++f) {
            if (task.fields[f].field == field) {
                keep_centres(centre, task.range, k, layer, centres[f]);
            }
        }
    });
    for (std::size_t f = 0; f < centres.size(); ++f) {
        context.centres.put(level, task.fields[f].field, centres[f]);
    }
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T)                                                        \
    template void run_and_carry(const PassContext&, const LevelTask<T>&, int, const Int3&, \
                                LevelSink&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

namespace {

/// The volume around a base block; values outside are those of the nearest node.
template <class T>
Box<T> gather_base(const StoreLayout& layout, const PlaneWindow& window, const Int3& block) {
    const std::int64_t k = layout.header().chunk;
    const Int3 ends = layout.lattice().cells_at(2) * 4;
    const Int3 lo = block * (2 * k) - Int3{kMargin, kMargin, kMargin};
    const Int3 hi = min((block + Int3{1, 1, 1}) * (2 * k), ends) + Int3{kMargin, kMargin, kMargin};
    Box<T> box(lo, hi - lo + Int3{1, 1, 1});
    const Int3 last = layout.lattice().nodes() - Int3{1, 1, 1};
    const std::int64_t x0 = std::clamp<std::int64_t>(lo.x, 0, last.x);
    const std::int64_t x1 = std::clamp<std::int64_t>(hi.x, 0, last.x);
    for (std::int64_t z = lo.z; z <= hi.z; ++z) {
        for (std::int64_t y = lo.y; y <= hi.y; ++y) {
            const T* const from = reinterpret_cast<const T*>(window.row(
                std::clamp<std::int64_t>(y, 0, last.y), std::clamp<std::int64_t>(z, 0, last.z)));
            T* const to = box.row(y, z);
            std::fill(to, to + (x0 - lo.x), from[x0]);
            std::copy(from + x0, from + x1 + 1, to + (x0 - lo.x));
            std::fill(to + (x1 - lo.x) + 1, to + box.size.x, from[x1]);
        }
    }
    return box;
}

}  // namespace

Int3 base_grid(const StoreLayout& layout) {
    const auto half = [](const Int3& grid) { return ceil_div(grid, {2, 2, 2}); };
    Int3 grid = half(layout.array(0, Field::values).grid);
    for (const ArrayInfo& array : layout.arrays()) {
        const bool values = array.field == Field::values;
        if (array.level == (values ? 1 : 2)) {
            grid = max(grid, array.grid);
        } else if (!values && array.level == 1) {
            grid = max(grid, half(array.grid));
        }
    }
    return grid;
}

std::pair<std::int64_t, std::int64_t> base_planes(const StoreLayout& layout, std::int64_t z) {
    const std::int64_t k = layout.header().chunk;
    const std::int64_t nz = layout.lattice().nodes().z;
    return {std::clamp<std::int64_t>(2 * k * z - kMargin, 0, nz - 1),
            std::clamp<std::int64_t>(2 * k * (z + 1) + kMargin + 1, 1, nz)};
}

template <class T>
std::vector<EncodedChunk> base_block(const PassContext& context, const PlaneWindow& window,
                                     const Int3& block) {
    const StoreLayout& layout = context.layout;
    const Lattice& lattice = layout.lattice();
    const std::int64_t k = layout.header().chunk;
    const Int3 two{2, 2, 2};
    const Int3 one{1, 1, 1};
    ValueBox<T> box;
    box.values = gather_base<T>(layout, window, block);
    box.find_missing();

    if (has_cube_ranges(lattice, kFirstRangeLevel)) {
        const Int3 first = block * cube_ranges_per_block(k);
        const Int3 end = first + one * cube_ranges_per_block(k);
        const Int3 count = min(end, lattice.cells_at(kFirstRangeLevel)) - first;
        Box<CubeRange> ranges(first, max(count, {0, 0, 0}));
        find_cube_ranges(box.values, lattice.nodes() - one, ranges);
        context.centres.put(ranges);
    }
    std::vector<EncodedChunk> out;
    encode_all_values(&layout.array(0, Field::values), block * 2, two, box.values, 1, out);
    encode_all_values(find_array(layout, 1, Field::values), block, one, box.values, 2, out);
    if (lattice.top() < 1) {
        return out;
    }

    // Level 1, one ring of cubes wider than the block, for the children of level 2's edges.
    const LayerRange ring{max(block * k - one, {0, 0, 0}),
                          min((block + one) * k + one, lattice.cells_at(1)), lattice.cells_at(1)};
    LevelTask<T> first = level_task(context, 1, ring, box);
    const LayerRange second = range_of(layout, 2, block * (k / 2), one * (k / 2));
    std::map<Field, Box<float>> centres;
    for (const Field field : fields_at(layout, 1)) {
        first.fields.push_back({field, nullptr});
        centres.emplace(field, Box<float>(second.lo * 2 - one, (second.hi - second.lo) * 2 + two));
    }
    LevelSink sink(layout, 1, block * 2, two);
    run_level(first, [&](Field field, std::int64_t z, const auto& layer) {
        sink.put(field, ring, z, layer);
        keep_centres(lattice.centre_slot(), ring, z, layer, centres.at(field));
    });
    sink.encode(out);
    if (lattice.top() < 2) {
        return out;
    }
    LevelTask<T> task = level_task(context, 2, second, box);
    for (const Field field : fields_at(layout, 2)) {
        task.fields.push_back({field, &centres.at(source_at_level_1(field))});
    }
    LevelSink coarse(layout, 2, block, one);
    run_and_carry(context, task, 2, one * (k / 2), coarse);
    coarse.encode(out);
    return out;
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T)                                                          \
    template std::vector<EncodedChunk> base_block<T>(const PassContext&, const PlaneWindow&, \
                                                     const Int3&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

namespace {

auto chunks_of(FinerLevels& finer, const ArrayInfo& array) {
    return [&](const Int3& chunk) { return finer.chunk(array, chunk); };
}

/// The deviations of level 1's cubes as stored (rounded up); NaN outside the volume.
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
    LevelTask<T> task = level_task(context, level, range, box);
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
