// Rows of values as the kernels take them, compiled for several instruction sets.
#pragma once

#include <cstdint>

#include <isonest/value_type.h>

namespace isonest::detail {

// For every value type T, no aliasing:

/// out[i] = in[i]; 0 where that is not finite.
template <class T>
void widen_row(const T* in, RealFor<T>* out, std::int64_t n);
/// even[i] = in[2 step i], odd[i] = in[2 step i + step], likewise widened.
template <class T>
void split_row(const T* in, std::int64_t step, RealFor<T>* even, RealFor<T>* odd, std::int64_t n);
/// out[i] = in[step i].
template <class T>
void take_row(const T* in, std::int64_t step, T* out, std::int64_t n);
/// low[i] and high[i] go down and up to in[i], unless that is NaN.
template <class T>
void range_row(const T* in, T* low, T* high, std::int64_t n);

/// Whether no value is NaN or infinite. Real: float or double.
template <class Real>
bool all_finite(const Real* in, std::int64_t n);

}  // namespace isonest::detail
