#include "preprocess/row_kernels.h"

#include <bit>
#include <cmath>

#include "store/simd.h"

namespace isonest {
namespace {

/// Calls use(i, difference) for every lane, with a loop of its own for each number of terms.
template <class Real, class Use>
[[gnu::always_inline]] inline void each_difference(const Interpolation<Real>& d, std::int64_t n,
                                                   const Use& use) {
    const Real* const v = d.value;
    const Real* const a = d.term[0];
    const Real* const b = d.term[1];
    const Real* const c = d.term[2];
    const Real* const e = d.term[3];
    const Real wa = d.weight[0];
    const Real wb = d.weight[1];
    const Real wc = d.weight[2];
    const Real we = d.weight[3];
    if (d.terms == 2) {
        for (std::int64_t i = 0; i < n; ++i) {
            use(i, std::fabs(v[i] - (wa * a[i] + wb * b[i])));
        }
    } else if (d.terms == 3) {
        for (std::int64_t i = 0; i < n; ++i) {
            use(i, std::fabs(v[i] - (wa * a[i] + wb * b[i] + wc * c[i])));
        }
    } else {
        for (std::int64_t i = 0; i < n; ++i) {
            use(i, std::fabs(v[i] - (wa * a[i] + wb * b[i] + wc * c[i] + we * e[i])));
        }
    }
}

template <class Real>
[[gnu::always_inline]] inline void differences_of(const Interpolation<Real>& d,
                                                  Real* __restrict out, std::int64_t n) {
    each_difference(d, n, [&](std::int64_t i, Real difference) { out[i] = difference; });
}

template <class Real>
[[gnu::always_inline]] inline void raise_differences_of(const Interpolation<Real>& d,
                                                        const Real* offset, Real* __restrict best,
                                                        std::int64_t n) {
    each_difference(d, n, [&](std::int64_t i, Real difference) {
        const Real sum = difference + offset[i];
        best[i] = sum > best[i] ? sum : best[i];
    });
}

template <class Real>
[[gnu::always_inline]] inline void raise_of(const Real* value, Real* __restrict best,
                                            std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        best[i] = value[i] > best[i] ? value[i] : best[i];
    }
}

template <class Real>
[[gnu::always_inline]] inline void raise_sum_of(const Real* a, const Real* b, Real* __restrict best,
                                                std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        const Real sum = a[i] + b[i];
        best[i] = sum > best[i] ? sum : best[i];
    }
}

template <class Real>
[[gnu::always_inline]] inline std::uint32_t bits_above(Real value) {
    const auto f = static_cast<float>(value);
    return std::bit_cast<std::uint32_t>(f) + (static_cast<Real>(f) < value ? 1U : 0U);
}

template <class Real>
[[gnu::always_inline]] inline void round_up_bits(const Real* in, std::uint32_t* __restrict out,
                                                 std::int64_t n, std::uint32_t mask) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = (bits_above(in[i]) + mask) & ~mask;
    }
}

template <class Real>
[[gnu::always_inline]] inline void round_up_floats(const Real* in, float* __restrict out,
                                                   std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = std::bit_cast<float>(bits_above(in[i]));
    }
}

}  // namespace

ISONEST_SIMD void round_up_row(const float* in, std::uint32_t* out, std::int64_t n,
                               std::uint32_t mask) {
    round_up_bits(in, out, n, mask);
}
ISONEST_SIMD void round_up_row(const double* in, std::uint32_t* out, std::int64_t n,
                               std::uint32_t mask) {
    round_up_bits(in, out, n, mask);
}
ISONEST_SIMD void round_up_row(const float* in, float* out, std::int64_t n) {
    round_up_floats(in, out, n);
}
ISONEST_SIMD void round_up_row(const double* in, float* out, std::int64_t n) {
    round_up_floats(in, out, n);
}
ISONEST_SIMD void differences(const Interpolation<float>& d, float* out, std::int64_t n) {
    differences_of(d, out, n);
}
ISONEST_SIMD void differences(const Interpolation<double>& d, double* out, std::int64_t n) {
    differences_of(d, out, n);
}
ISONEST_SIMD void raise_differences(const Interpolation<float>& d, const float* offset, float* best,
                                    std::int64_t n) {
    raise_differences_of(d, offset, best, n);
}
ISONEST_SIMD void raise_differences(const Interpolation<double>& d, const double* offset,
                                    double* best, std::int64_t n) {
    raise_differences_of(d, offset, best, n);
}
ISONEST_SIMD void raise(const float* value, float* best, std::int64_t n) {
    raise_of(value, best, n);
}
ISONEST_SIMD void raise(const double* value, double* best, std::int64_t n) {
    raise_of(value, best, n);
}
ISONEST_SIMD void raise_sum(const float* a, const float* b, float* best, std::int64_t n) {
    raise_sum_of(a, b, best, n);
}
ISONEST_SIMD void raise_sum(const double* a, const double* b, double* best, std::int64_t n) {
    raise_sum_of(a, b, best, n);
}

}  // namespace isonest
