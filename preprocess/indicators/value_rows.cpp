#include "preprocess/indicators/value_rows.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

#include <isonest/value_type.h>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

template <class T>
[[gnu::always_inline]] inline bool is_finite(T v) {
    return std::fabs(v) <= std::numeric_limits<T>::max();
}

template <class T>
[[gnu::always_inline]] inline RealFor<T> widened(T v) {
    if constexpr (std::is_floating_point_v<T>) {
        return is_finite(v) ? static_cast<RealFor<T>>(v) : RealFor<T>{0};
    } else {
        return static_cast<RealFor<T>>(v);
    }
}

}  // namespace

template <class T>
ISONEST_SIMD void widen_row(const T* in, RealFor<T>* __restrict out, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = widened(in[i]);
    }
}

template <class T>
ISONEST_SIMD void split_row(const T* in, std::int64_t step, RealFor<T>* __restrict even,
                            RealFor<T>* __restrict odd, std::int64_t n) {
    if (step == 1) {
        for (std::int64_t i = 0; i < n; ++i) {
            even[i] = widened(in[2 * i]);
            odd[i] = widened(in[2 * i + 1]);
        }
        return;
    }
    for (std::int64_t i = 0; i < n; ++i) {
        even[i] = widened(in[2 * step * i]);
        odd[i] = widened(in[2 * step * i + step]);
    }
}

template <class T>
ISONEST_SIMD void take_row(const T* in, std::int64_t step, T* __restrict out, std::int64_t n) {
    if (step == 1) {
        std::memcpy(out, in, static_cast<std::size_t>(n) * sizeof(T));
    } else {
        for (std::int64_t i = 0; i < n; ++i) {
            out[i] = in[step * i];
        }
    }
}

template <class T>
ISONEST_SIMD void range_row(const T* in, T* __restrict low, T* __restrict high, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        low[i] = in[i] < low[i] ? in[i] : low[i];
        high[i] = in[i] > high[i] ? in[i] : high[i];
    }
}

template <class Real>
ISONEST_SIMD bool all_finite(const Real* in, std::int64_t n) {
    std::int64_t finite = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        finite += is_finite(in[i]) ? 1 : 0;
    }
    return finite == n;
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T)                                                             \
    template void widen_row<T>(const T*, RealFor<T>*, std::int64_t);                            \
    template void split_row<T>(const T*, std::int64_t, RealFor<T>*, RealFor<T>*, std::int64_t); \
    template void take_row<T>(const T*, std::int64_t, T*, std::int64_t);                        \
    template void range_row<T>(const T*, T*, T*, std::int64_t);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)
template bool all_finite(const float*, std::int64_t);
template bool all_finite(const double*, std::int64_t);

template <class T>
void find_cube_ranges(const Box<T>& values, const Int3& last, Box<CubeRange>& to) {
    if (to.size.product() == 0) {
        return;
    }
    const Int3 first = to.lo * kFirstRangeEdge;
    const Int3 end = min((to.lo + to.size) * kFirstRangeEdge, last);
    const std::int64_t n = end.x - first.x + 1;
    // Initial bounds: no value is above kMax or below kMin. Without any value the range stays
    // empty.
    constexpr bool kReal = std::is_floating_point_v<T>;
    constexpr T kMax = kReal ? std::numeric_limits<T>::infinity() : std::numeric_limits<T>::max();
    constexpr T kMin =
        kReal ? -std::numeric_limits<T>::infinity() : std::numeric_limits<T>::lowest();
    std::vector<T> low(static_cast<std::size_t>(n));
    std::vector<T> high(low.size());
    for (std::int64_t cz = to.lo.z; cz < to.lo.z + to.size.z; ++cz) {
        for (std::int64_t cy = to.lo.y; cy < to.lo.y + to.size.y; ++cy) {
            low.assign(low.size(), kMax);
            high.assign(high.size(), kMin);
            for (std::int64_t z = cz * kFirstRangeEdge;
                 z <= std::min((cz + 1) * kFirstRangeEdge, last.z); ++z) {
                for (std::int64_t y = cy * kFirstRangeEdge;
                     y <= std::min((cy + 1) * kFirstRangeEdge, last.y); ++y) {
                    range_row(values.row(y, z) + (first.x - values.lo.x), low.data(), high.data(),
                              n);
                }
            }
            for (std::int64_t cx = to.lo.x; cx < to.lo.x + to.size.x; ++cx) {
                T least = kMax;
                T most = kMin;
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
