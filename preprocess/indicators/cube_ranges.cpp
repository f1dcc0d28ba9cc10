#include "preprocess/indicators/cube_ranges.h"

#include <algorithm>
#include <limits>
#include <type_traits>
#include <vector>

#include <isonest/value_type.h>

#include "preprocess/indicators/value_rows.h"

namespace isonest::detail {

template <class T>
void find_cube_ranges(const Box<T>& values, const Int3& last, Box<CubeRange>& to) {
    if (to.size.product() == 0) {
        return;
    }
    const Int3 first = to.lo * kFirstRangeEdge;
    const Int3 end = min((to.lo + to.size) * kFirstRangeEdge, last);
    const std::int64_t n = end.x - first.x + 1;
    // Nothing is below the one or above the other: what is left is no value.
    constexpr bool kReal = std::is_floating_point_v<T>;
    constexpr T kMost = kReal ? std::numeric_limits<T>::infinity() : std::numeric_limits<T>::max();
    constexpr T kLeast =
        kReal ? -std::numeric_limits<T>::infinity() : std::numeric_limits<T>::lowest();
    std::vector<T> low(static_cast<std::size_t>(n));
    std::vector<T> high(low.size());
    for (std::int64_t cz = to.lo.z; cz < to.lo.z + to.size.z; ++cz) {
        for (std::int64_t cy = to.lo.y; cy < to.lo.y + to.size.y; ++cy) {
            low.assign(low.size(), kMost);
            high.assign(high.size(), kLeast);
            for (std::int64_t z = cz * kFirstRangeEdge;
                 z <= std::min((cz + 1) * kFirstRangeEdge, last.z); ++z) {
                for (std::int64_t y = cy * kFirstRangeEdge;
                     y <= std::min((cy + 1) * kFirstRangeEdge, last.y); ++y) {
                    range_row(values.row(y, z) + (first.x - values.lo.x), low.data(), high.data(),
                              n);
                }
            }
            for (std::int64_t cx = to.lo.x; cx < to.lo.x + to.size.x; ++cx) {
                T least = kMost;
                T most = kLeast;
                const std::int64_t stop = std::min((cx + 1) * kFirstRangeEdge, last.x);
                for (std::int64_t x = cx * kFirstRangeEdge; x <= stop; ++x) {
                    const auto i = static_cast<std::size_t>(x - first.x);
                    least = std::min(least, low[i]);
                    most = std::max(most, high[i]);
                }
                to.at({cx, cy, cz}) =
                    cube_range_around(static_cast<double>(least), static_cast<double>(most));
            }
        }
    }
}

void merge_cube_ranges(std::span<const CubeRange> fine, const Int3& fine_cells,
                       std::span<CubeRange> coarse, const Int3& coarse_cells) {
    std::fill(coarse.begin(), coarse.end(), CubeRange{});
    for (std::size_t i = 0; i < fine.size(); ++i) {
        const Int3 cube = fine_cells.unlinear(static_cast<std::int64_t>(i));
        const Int3 parent{cube.x / 2, cube.y / 2, cube.z / 2};
        coarse[static_cast<std::size_t>(coarse_cells.linear(parent))].include(fine[i]);
    }
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T) \
    template void find_cube_ranges(const Box<T>&, const Int3&, Box<CubeRange>&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

}  // namespace isonest::detail
