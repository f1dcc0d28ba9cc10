#include "preprocess/levels/level_pass.h"

#include <algorithm>
#include <cstring>
#include <map>

#include "preprocess/indicators/cube_ranges.h"
#include "preprocess/indicators/row_kernels.h"
#include "preprocess/levels/value_chunks.h"
#include "store/container/codec.h"
#include "store/container/gather.h"

namespace isonest::detail {
namespace {

/// Nodes that a base block needs beyond its own: two for the deviation of level 2, and one more
/// for missing values beside the finer cubes that its edges look at.
constexpr std::int64_t kMargin = 3;

const ArrayInfo* find(const StoreLayout& layout, int level, Field field) {
    return level <= layout.lattice().top() && layout.has(field) ? &layout.array(level, field)
                                                                : nullptr;
}

/// The volume around a base block, values outside being those of the nearest node.
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

/// The indicator chunks of one level that a block fills.
class LevelSink {
  public:
    LevelSink(const StoreLayout& layout, int level, const Int3& first, const Int3& count) {
        for (const Field field : layout.header().fields) {
            const ArrayInfo* const array = find(layout, level, field);
            if (array == nullptr || array->alias) {
                continue;
            }
            parts_.emplace_back(level == 1 ? source_at_level_1(field) : field,
                                IndicatorChunks(*array, first, count, layout.header().exact));
        }
    }
    template <class Real>
    void put(Field field, const LayerRange& range, std::int64_t k, const Layer<Real>& layer) {
        for (auto& [source, chunks] : parts_) {
            if (source == field) {
                chunks.put(range, k, layer);
            }
        }
    }
    void encode(std::vector<EncodedChunk>& out) const {
        for (const auto& part : parts_) {
            part.second.encode(out);
        }
    }

  private:
    std::vector<std::pair<Field, IndicatorChunks>> parts_;
};

/// Copies the centres of layer k (in slot `centre`) that lie in `to`.
template <class Real>
void keep_centres(int centre, const LayerRange& range, std::int64_t k, const Layer<Real>& layer,
                  Box<float>& to) {
    const Int3 o = slot_offset(centre);
    const auto count = [&](int axis) { return range.count(axis, static_cast<int>(o[axis])); };
    if (k < to.lo.z || k >= to.lo.z + to.size.z || k - range.lo.z >= count(2)) {
        return;
    }
    const Int3 lo = max(range.lo, to.lo);
    const Int3 end = min(range.lo + Int3{count(0), count(1), 0}, to.lo + to.size);
    for (std::int64_t y = lo.y; y < end.y; ++y) {
        const Real* const from = layer.row(centre, y - range.lo.y);
        round_up_row(from + (lo.x - range.lo.x), to.row(y, k) + (lo.x - to.lo.x),
                     std::max<std::int64_t>(end.x - lo.x, 0));
    }
}

LayerRange range_of(const StoreLayout& layout, int level, const Int3& first, std::int64_t count) {
    const Int3 cells = layout.lattice().cells_at(level);
    return {first, min(first + Int3{count, count, count}, cells), cells};
}

/// Cubes of the level inside a block, for the centres that the block hands on.
Box<float> own_cubes(const LayerRange& range, std::int64_t count) {
    const Int3 end = min(range.lo + Int3{count, count, count}, max(range.cells, {1, 1, 1}));
    return {range.lo, max(end - range.lo, {0, 0, 0})};
}

/// The field that tells how far the finest function can be from a finer level's.
Field deviation_carried(const StoreLayout& layout) {
    return layout.has(Field::deviation_bar) ? Field::deviation_bar : Field::deviation_plus;
}

/// The deviations of level 1's cubes as they were stored (rounded up); NaN outside of the volume.
void gather_finest_deviation(ChunkCache& cache, const StoreLayout& layout, Box<float>& box) {
    const ArrayInfo& array = layout.array(1, deviation_carried(layout));
    const Int3 cells = layout.lattice().elements_at(1);
    std::fill(box.data.begin(), box.data.end(), std::numeric_limits<float>::quiet_NaN());
    const Int3 lo = max(box.lo, {0, 0, 0});
    const Int3 size = max(min(box.lo + box.size, cells) - lo, {0, 0, 0});
    if (size.product() == 0) {
        return;
    }
    const auto copy = [&](auto from) {
        gather_values(cache, array, from);
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

/// The fields to compute at a level, none twice.
std::vector<Field> fields_at(const StoreLayout& layout, int level) {
    std::vector<Field> fields = layout.header().fields;
    if (level == 1) {
        std::transform(fields.begin(), fields.end(), fields.begin(), source_at_level_1);
        std::sort(fields.begin(), fields.end());
        fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    }
    return fields;
}

template <class T>
LevelTask<T> level_task(const StoreLayout& layout, int level, const LayerRange& range,
                        const ValueBox<T>& box) {
    LevelTask<T> task;
    task.range = range;
    task.values = &box;
    task.step = level == 1 ? 1 : 2;
    task.level = level;
    task.spacing = layout.header().spacing;
    task.flat = layout.lattice().flat_axes();
    task.fine_cells = layout.lattice().cells_at(std::max(level - 2, 0));
    return task;
}

/// Runs one level and hands its centres to the coarser levels.
template <class T>
void run_and_carry(const PassContext& context, const LevelTask<T>& task, int level,
                   std::int64_t count, LevelSink& sink) {
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
    encode_all_values(find(layout, 1, Field::values), block, one, box.values, 2, out);
    if (lattice.top() < 1) {
        return out;
    }

    // Level 1, one ring of cubes wider than the block, for the children of level 2's edges.
    const LayerRange ring{max(block * k - one, {0, 0, 0}),
                          min((block + one) * k + one, lattice.cells_at(1)), lattice.cells_at(1)};
    LevelTask<T> first = level_task(layout, 1, ring, box);
    const LayerRange second = range_of(layout, 2, block * (k / 2), k / 2);
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
    LevelTask<T> task = level_task(layout, 2, second, box);
    for (const Field field : fields_at(layout, 2)) {
        task.fields.push_back({field, &centres.at(source_at_level_1(field))});
    }
    LevelSink coarse(layout, 2, block, one);
    run_and_carry(context, task, 2, k / 2, coarse);
    coarse.encode(out);
    return out;
}

Int3 level_grid(const StoreLayout& layout, int level) {
    Int3 grid = layout.array(level - 1, Field::values).grid;
    for (const ArrayInfo& array : layout.arrays()) {
        if (array.level == level && array.field != Field::values) {
            grid = max(grid, array.grid);
        }
    }
    return grid;
}

template <class T>
std::vector<EncodedChunk> level_block_of(const PassContext& context, ChunkCache& cache, int level,
                                         const Int3& block) {
    const StoreLayout& layout = context.layout;
    const std::int64_t k = layout.header().chunk;
    const Int3 one{1, 1, 1};
    const Int3 two{2, 2, 2};
    const LayerRange range = range_of(layout, level, block * (k / 2), k / 2);
    ValueBox<T> box;
    box.values = Box<T>(range.lo * 4 - one * kMargin, (range.hi - range.lo) * 4 + one * 7);
    gather_values(cache, layout.array(level - 2, Field::values), box.values);
    box.find_missing();

    std::vector<EncodedChunk> out;
    encode_all_values(&layout.array(level - 1, Field::values), block, one, box.values, 2, out);

    LevelTask<T> task = level_task(layout, level, range, box);
    std::vector<Box<float>> centres(
        layout.header().fields.size(),
        Box<float>(range.lo * 2 - one, (range.hi - range.lo) * 2 + two));
    for (std::size_t f = 0; f < centres.size(); ++f) {
        const Field field = layout.header().fields[f];
        context.centres.get(level - 1, field, 0.0F, centres[f]);
        task.fields.push_back({field, &centres[f]});
    }
    Box<float> fine;
    if (task.wants(Indicator::deviation)) {
        fine = Box<float>(box.values.lo, box.values.size);
        if (level == 3) {
            gather_finest_deviation(cache, layout, fine);
        } else {
            context.centres.get(level - 2, deviation_carried(layout),
                                std::numeric_limits<float>::quiet_NaN(), fine);
        }
        task.fine_deviation = &fine;
    }
    LevelSink sink(layout, level, block, one);
    run_and_carry(context, task, level, k / 2, sink);
    sink.encode(out);
    return out;
}

template <class T>
std::vector<EncodedChunk> top_values(const PassContext& context, ChunkCache& cache) {
    const StoreLayout& layout = context.layout;
    const int top = layout.lattice().top();
    const ArrayInfo& array = layout.array(top, Field::values);
    Box<T> box({0, 0, 0}, (array.nodes - Int3{1, 1, 1}) * 2 + Int3{1, 1, 1});
    gather_values(cache, layout.array(top - 1, Field::values), box);
    std::vector<EncodedChunk> out;
    encode_all_values(&array, {0, 0, 0}, array.grid, box, 2, out);
    return out;
}

std::uint64_t block_heap(const StoreLayout& layout) {
    const auto k = static_cast<std::uint64_t>(layout.header().chunk);
    const std::uint64_t value = size_of(layout.header().type);
    const std::uint64_t code = layout.header().exact ? 4 : 2;
    const std::uint64_t fields = layout.header().fields.size();
    const std::uint64_t box = (2 * k + 7) * (2 * k + 7) * (2 * k + 7);
    const std::uint64_t chunk = k * k * k;
    // Indicators of a base block (2 x 2 x 2 chunks of level 1, one of level 2), once raw and once
    // encoded; centres that are handed on; the kernels' planes; the codec.
    std::uint64_t elements = 0;
    for (const Field field : layout.header().fields) {
        elements += chunk * (centre_suffices_at_level_1(field) ? 1 : kSlots) + chunk / 8 * kSlots;
    }
    const std::uint64_t common = elements * code * 2 + fields * 4 * (k + 2) * (k + 2) * (k + 2) +
                                 fields * 2 * kSlots * 8 * (k + 4) * (k + 4) +
                                 24 * 8 * (2 * k + 16) * (2 * k + 16) +
                                 codec_heap(chunk * value, layout.header().compression);
    // The base block encodes its 2 x 2 x 2 chunks of values and those of level 1; coarser blocks
    // hold the finer deviations beside the values.
    return common + box * value + std::max(10 * chunk * value, box * 4);
}

#define ISONEST_INSTANTIATE(T)                                                                 \
    template std::vector<EncodedChunk> base_block<T>(const PassContext&, const PlaneWindow&,   \
                                                     const Int3&);                             \
    template std::vector<EncodedChunk> level_block_of<T>(const PassContext&, ChunkCache&, int, \
                                                         const Int3&);                         \
    template std::vector<EncodedChunk> top_values<T>(const PassContext&, ChunkCache&)
ISONEST_INSTANTIATE(std::uint8_t);
ISONEST_INSTANTIATE(std::int8_t);
ISONEST_INSTANTIATE(std::uint16_t);
ISONEST_INSTANTIATE(std::int16_t);
ISONEST_INSTANTIATE(std::uint32_t);
ISONEST_INSTANTIATE(std::int32_t);
ISONEST_INSTANTIATE(float);
ISONEST_INSTANTIATE(double);
#undef ISONEST_INSTANTIATE

}  // namespace isonest::detail
