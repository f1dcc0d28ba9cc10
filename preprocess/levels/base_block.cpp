#include "preprocess/levels/base_block.h"

#include <algorithm>
#include <map>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/cube_ranges.h"
#include "preprocess/levels/carried_level.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/value_chunks.h"
#include "store/base/box.h"
#include "store/container/cube_range.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

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
    LevelTask<T> first = level_task(layout, 1, ring, box);
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
    LevelTask<T> task = level_task(layout, 2, second, box);
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

}  // namespace isonest::detail
