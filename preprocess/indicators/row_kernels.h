// The inner loops of the level pass over rows of numbers; compiled for several instruction sets.
#pragma once

#include <cstdint>
#include <utility>

#include "store/container/codec.h"

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
    bool outward = false;  ///< the result is at least the exact difference. REQUIRES: weights are
                           ///< powers of two
};

// Real is float or double.

/// out[i] = difference. No aliasing between out and the inputs.
template <class Real>
void differences(const Interpolation<Real>& d, Real* out, std::int64_t n);

/// best[i] = max(best[i], difference + offset[i]); NaN sums are ignored. A null offset means 0.
template <class Real>
void raise_differences(const Interpolation<Real>& d, const Real* offset, Real* best,
                       std::int64_t n);

/// best[i] = max(best[i], value[i]), and max(best[i], a[i] + b[i]); NaN is ignored.
template <class Real>
void raise(const Real* value, Real* best, std::int64_t n);
template <class Real>
void raise_sum(const Real* a, const Real* b, Real* best, std::int64_t n);

/// best[i] = max(best[i], the largest of a, b, c, d at i), and sum[i] += that largest. The last
/// array must not alias the others.
template <class Real>
void raise_by_four(const Real* a, const Real* b, const Real* c, const Real* d, Real* best,
                   std::int64_t n);
template <class Real>
void add_largest_of_four(const Real* a, const Real* b, const Real* c, const Real* d, Real* sum,
                         std::int64_t n);

/// out[i] = |mid[i] - (a[i] + b[i]) / 2|. `outward`: at least the exact value
/// (store/base/vectors.h); must not be set for float32, where all sums are exact (RealFor).
template <class Real>
void midpoint_offsets(const Real* mid, const Real* a, const Real* b, Real* out, std::int64_t n,
                      bool outward);

/// The same on diagonals that alternate their direction from lane to lane: from a[i] to b[i + 1] if
/// first + i is even, else from a[i + 1] to b[i].
template <class Real>
void diagonal_offsets(const Real* mid, const Real* a, const Real* b, std::int64_t first, Real* out,
                      std::int64_t n, bool outward);

/// out[i] = the smallest code, or binary32, whose value is >= in[i]. Returns the smallest and the
/// largest of them (undefined if n is 0). Stored: IndicatorCode or float. REQUIRES: in[i] >= 0 or
/// +inf. No aliasing.
template <class Real, class Stored>
std::pair<Stored, Stored> round_up_row(const Real* in, Stored* out, std::int64_t n);

}  // namespace isonest::detail
