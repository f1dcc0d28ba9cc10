// The inner loops of the level pass over rows of numbers, compiled for several instruction sets.
#pragma once

#include <cstdint>
#include <utility>

#include "store/container/indicator_code.h"

namespace isonest::detail {

template <class Real>
[[gnu::always_inline]] inline Real larger(Real a, Real b) {
    return a < b ? b : a;
}

/// Differences between values and a linear interpolation of up to four others, one per lane:
/// |v[i] - sum of weight[t] * term[t][i]|.
template <class Real>
struct Interpolation {
    const Real* value = nullptr;
    const Real* term[4] = {};
    Real weight[4] = {};
    int terms = 0;         ///< 2 to 4
    bool outward = false;  ///< at least the exact difference. REQUIRES: weights are powers of two
};

/// out[i] = difference. No aliasing between out and the inputs.
void differences(const Interpolation<float>& d, float* out, std::int64_t n);
void differences(const Interpolation<double>& d, double* out, std::int64_t n);

/// best[i] = max(best[i], difference + offset[i]); a sum that is NaN changes nothing. A null offset
/// is 0.
void raise_differences(const Interpolation<float>& d, const float* offset, float* best,
                       std::int64_t n);
void raise_differences(const Interpolation<double>& d, const double* offset, double* best,
                       std::int64_t n);

/// best[i] = max(best[i], value[i]) and max(best[i], a[i] + b[i]); NaN changes nothing.
void raise(const float* value, float* best, std::int64_t n);
void raise(const double* value, double* best, std::int64_t n);
void raise_sum(const float* a, const float* b, float* best, std::int64_t n);
void raise_sum(const double* a, const double* b, double* best, std::int64_t n);

/// best[i] = max(best[i], the largest of a, b, c, d at i), and sum[i] += that. No aliasing of the
/// last argument.
void raise_by_four(const float* a, const float* b, const float* c, const float* d, float* best,
                   std::int64_t n);
void raise_by_four(const double* a, const double* b, const double* c, const double* d, double* best,
                   std::int64_t n);
void add_largest_of_four(const float* a, const float* b, const float* c, const float* d, float* sum,
                         std::int64_t n);
void add_largest_of_four(const double* a, const double* b, const double* c, const double* d,
                         double* sum, std::int64_t n);

/// out[i] = |mid[i] - (a[i] + b[i]) / 2|; `outward`: at least that, exactly (store/base/outward.h).
/// In float32 it must not be asked for: there all sums are exact (RealFor).
void midpoint_offsets(const float* mid, const float* a, const float* b, float* out, std::int64_t n,
                      bool outward);
void midpoint_offsets(const double* mid, const double* a, const double* b, double* out,
                      std::int64_t n, bool outward);

/// The same on diagonals that change their direction from lane to lane: from a[i] to b[i + 1] where
/// first + i is even, else from a[i + 1] to b[i].
void diagonal_offsets(const float* mid, const float* a, const float* b, std::int64_t first,
                      float* out, std::int64_t n, bool outward);
void diagonal_offsets(const double* mid, const double* a, const double* b, std::int64_t first,
                      double* out, std::int64_t n, bool outward);

/// out[i] = the smallest code, or binary32, whose value is >= in[i]; the smallest and the largest
/// of them (of no meaning if n is 0). REQUIRES: in[i] >= 0 or +inf. No aliasing.
std::pair<IndicatorCode, IndicatorCode> round_up_row(const float* in, IndicatorCode* out,
                                                     std::int64_t n);
std::pair<IndicatorCode, IndicatorCode> round_up_row(const double* in, IndicatorCode* out,
                                                     std::int64_t n);
std::pair<float, float> round_up_row(const float* in, float* out, std::int64_t n);
std::pair<float, float> round_up_row(const double* in, float* out, std::int64_t n);

}  // namespace isonest::detail
