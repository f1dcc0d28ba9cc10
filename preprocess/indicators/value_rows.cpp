#include "preprocess/indicators/value_rows.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "store/base/simd.h"

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

}  // namespace isonest::detail
