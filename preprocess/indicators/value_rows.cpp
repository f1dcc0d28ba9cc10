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

template <class T>
[[gnu::always_inline]] inline void widen(const T* in, RealFor<T>* __restrict out, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = widened(in[i]);
    }
}

template <class T>
[[gnu::always_inline]] inline void split(const T* in, std::int64_t step,
                                         RealFor<T>* __restrict even, RealFor<T>* __restrict odd,
                                         std::int64_t n) {
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
[[gnu::always_inline]] inline void take(const T* in, std::int64_t step, T* __restrict out,
                                        std::int64_t n) {
    if (step == 1) {
        std::memcpy(out, in, static_cast<std::size_t>(n) * sizeof(T));
    } else {
        for (std::int64_t i = 0; i < n; ++i) {
            out[i] = in[step * i];
        }
    }
}

template <class T>
[[gnu::always_inline]] inline void range(const T* in, T* __restrict low, T* __restrict high,
                                         std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        low[i] = in[i] < low[i] ? in[i] : low[i];
        high[i] = in[i] > high[i] ? in[i] : high[i];
    }
}

template <class T>
[[gnu::always_inline]] inline bool finite_row(const T* in, std::int64_t n) {
    std::int64_t finite = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        finite += is_finite(in[i]) ? 1 : 0;
    }
    return finite == n;
}

}  // namespace

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_DEFINE(T)                                                                          \
    ISONEST_SIMD void widen_row(const T* in, RealFor<T>* out, std::int64_t n) {                    \
        widen(in, out, n);                                                                         \
    }                                                                                              \
    ISONEST_SIMD void split_row(const T* in, std::int64_t step, RealFor<T>* even, RealFor<T>* odd, \
                                std::int64_t n) {                                                  \
        split(in, step, even, odd, n);                                                             \
    }                                                                                              \
    ISONEST_SIMD void take_row(const T* in, std::int64_t step, T* out, std::int64_t n) {           \
        take(in, step, out, n);                                                                    \
    }                                                                                              \
    ISONEST_SIMD void range_row(const T* in, T* low, T* high, std::int64_t n) {                    \
        range(in, low, high, n);                                                                   \
    }
ISONEST_VALUE_TYPES(ISONEST_DEFINE)
#undef ISONEST_DEFINE
// NOLINTEND(bugprone-macro-parentheses)

ISONEST_SIMD bool all_finite(const float* in, std::int64_t n) {
    return finite_row(in, n);
}
ISONEST_SIMD bool all_finite(const double* in, std::int64_t n) {
    return finite_row(in, n);
}

}  // namespace isonest::detail
