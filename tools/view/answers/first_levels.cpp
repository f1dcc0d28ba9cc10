// The bound of a level covers everything below it, so its largest value, which the catalogue has,
// is an error at which no element is refined beyond that level.
#include "tools/view/answers/first_levels.h"

#include <vector>

namespace isonest::detail::view {

namespace {

/// Those that a traversal reads of a store that is far.
void want_ranges(const StoreReader& store) {
    const StoreLayout& layout = store.layout();
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        const auto cubes = static_cast<std::uint64_t>(layout.lattice().cells_at(level).product());
        if (cubes * cube_range_bytes(layout.header().type) <= CubeRangeTable::kMostFar) {
            store.prefetch_cube_ranges(level);
        }
    }
}

}  // namespace

std::optional<FirstLevels> fetch_first_levels(const StoreReader& store) {
    const StoreLayout& layout = store.layout();
    const std::optional<Field> bound = layout.tightest_bound();
    const bool are_labels = layout.header().labels || store.label_names().size() > 0;
    if (!store.is_far() || store.catalogue() == nullptr || !bound || are_labels) {
        return std::nullopt;
    }
    std::optional<FirstLevels> first;
    std::vector<WantedChunk> chunks;
    std::uint64_t bytes = 0;
    for (int level = layout.lattice().top(); level >= 1; --level) {
        const ArrayInfo& values = layout.array(level, Field::values);
        const ArrayInfo& bounds = layout.array(level, *bound);
        const ArrayTotals of_bounds = store.totals(bounds);
        bytes += store.totals(values).bytes + of_bounds.bytes;
        if (bytes > FirstLevels::kMostBytes) {
            break;
        }
        for (const ArrayInfo* const array : {&values, &bounds}) {
            for (std::int64_t i = 0; i < array->grid.product(); ++i) {
                chunks.push_back({array, array->grid.unlinear(i)});
            }
        }
        first = FirstLevels{level, of_bounds.max};
    }
    if (first) {
        store.prefetch_all(chunks);
        want_ranges(store);
    }
    return first;
}

}  // namespace isonest::detail::view
