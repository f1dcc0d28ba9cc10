// Rows of values as the kernels take them, compiled for several instruction sets.
#pragma once

#include <cstdint>

#include <isonest/value_type.h>

namespace isonest::detail {

/// Calls macro X with each type of store/public/isonest/value_type.h.
#define ISONEST_VALUE_TYPES(X) \
    X(std::uint8_t)            \
    X(std::int8_t)             \
    X(std::uint16_t) X(std::int16_t) X(std::uint32_t) X(std::int32_t) X(float) X(double)

// For every value type T, no aliasing:
//   widen_row: out[i] = in[i]; 0 where that is not finite.
//   split_row: even[i] = in[2 step i], odd[i] = in[2 step i + step], likewise widened.
//   take_row: out[i] = in[step i].
//   range_row: low[i] and high[i] go down and up to in[i], unless that is NaN.
// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_DECLARE(T)                                                            \
    void widen_row(const T* in, RealFor<T>* out, std::int64_t n);                     \
    void split_row(const T* in, std::int64_t step, RealFor<T>* even, RealFor<T>* odd, \
                   std::int64_t n);                                                   \
    void take_row(const T* in, std::int64_t step, T* out, std::int64_t n);            \
    void range_row(const T* in, T* low, T* high, std::int64_t n);
ISONEST_VALUE_TYPES(ISONEST_DECLARE)
#undef ISONEST_DECLARE
// NOLINTEND(bugprone-macro-parentheses)

/// Whether no value is NaN or infinite.
bool all_finite(const float* in, std::int64_t n);
bool all_finite(const double* in, std::int64_t n);

}  // namespace isonest::detail
