#include "preprocess/indicators/row_kernels.h"

#include <bit>
#include <cmath>
#include <limits>
#include <type_traits>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

/// Calls use(i, difference) for every lane, with a separate loop for each number of terms.
template <class Real, class Use>
[[gnu::always_inline]] inline void each_nearest_difference(const Interpolation<Real>& d,
                                                           std::int64_t n, const Use& use) {
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

/// The same for doubles, with results that are at least the exact differences.
template <class Use>
[[gnu::always_inline]] inline void each_outward_difference(const Interpolation<double>& d,
                                                           std::int64_t n, const Use& use) {
    const auto with = [&](auto terms) {
        for (std::int64_t i = 0; i < n; ++i) {
            double sum = d.weight[0] * d.term[0][i];
            double lost = 0;
            double size = 0;
            for (int t = 1; t < terms; ++t) {
                const double term = d.weight[t] * d.term[t][i];
                const double next = sum + term;
                const double by_sum = lost_by_sum(sum, term, next);
                lost += by_sum;
                size += std::fabs(by_sum);
                sum = next;
            }
            const double difference = d.value[i] - sum;
            const double rest = lost_by_sum(d.value[i], -sum, difference) - lost;
            use(i, outward(difference, rest, size * 0x1p-50));
        }
    };
    if (d.terms == 2) {
        with(std::integral_constant<int, 2>{});
    } else if (d.terms == 3) {
        with(std::integral_constant<int, 3>{});
    } else {
        with(std::integral_constant<int, 4>{});
    }
}

/// Chooses between the two according to d.outward.
template <class Real, class Use>
[[gnu::always_inline]] inline void each_difference(const Interpolation<Real>& d, std::int64_t n,
                                                   const Use& use) {
    if constexpr (std::is_same_v<Real, double>) {
        if (d.outward) {
            each_outward_difference(d, n, use);
            return;
        }
    }
    each_nearest_difference(d, n, use);
}

/// |mid - (a + b) / 2|, or at least the exact value.
template <bool kOutward, class Real>
[[gnu::always_inline]] inline Real offset(Real mid, Real a, Real b) {
    if constexpr (kOutward) {
        return outward_offset(mid, a, b);
    } else {
        return std::fabs(mid - Real{0.5} * (a + b));
    }
}

template <bool kOutward, class Real>
[[gnu::always_inline]] inline void midpoint_offsets_of(const Real* mid, const Real* a,
                                                       const Real* b, Real* __restrict out,
                                                       std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        out[i] = offset<kOutward>(mid[i], a[i], b[i]);
    }
}

template <class Real>
[[gnu::always_inline]] inline void diagonal_offsets_of(const Real* mid, const Real* a,
                                                       const Real* b, std::int64_t first,
                                                       Real* __restrict out, std::int64_t n) {
    const auto parity = static_cast<int>(first & 1);
    const auto count = static_cast<int>(n);
    for (int i = 0; i < count; ++i) {
        const Real same = a[i] + b[i + 1];
        const Real cross = a[i + 1] + b[i];
        out[i] = std::fabs(mid[i] - Real{0.5} * (((parity + i) & 1) == 0 ? same : cross));
    }
}

[[gnu::always_inline]] inline void outward_diagonal_offsets_of(const double* mid, const double* a,
                                                               const double* b, std::int64_t first,
                                                               double* __restrict out,
                                                               std::int64_t n) {
    const auto parity = static_cast<int>(first & 1);
    const auto count = static_cast<int>(n);
    for (int i = 0; i < count; ++i) {
        const bool same = ((parity + i) & 1) == 0;
        out[i] = outward_offset(mid[i], same ? a[i] : a[i + 1], same ? b[i + 1] : b[i]);
    }
}

inline void round_up(float value, float& out) {
    out = value;
}
inline void round_up(double value, float& out) {
    out = round_up_to_float(value);
}
template <class Real>
inline void round_up(Real value, IndicatorCode& out) {
    out = encode_indicator(round_up_to_float(value));
}

}  // namespace

template <class Real>
ISONEST_SIMD void differences(const Interpolation<Real>& d, Real* __restrict out, std::int64_t n) {
    each_difference(d, n, [&](std::int64_t i, Real difference) { out[i] = difference; });
}

template <class Real>
ISONEST_SIMD void raise_differences(const Interpolation<Real>& d, const Real* offset,
                                    Real* __restrict best, std::int64_t n) {
    if (offset == nullptr) {
        each_difference(d, n, [&](std::int64_t i, Real difference) {
            best[i] = difference > best[i] ? difference : best[i];
        });
    } else {
        each_difference(d, n, [&](std::int64_t i, Real difference) {
            const Real sum = difference + offset[i];
            best[i] = sum > best[i] ? sum : best[i];
        });
    }
}

template <class Real>
ISONEST_SIMD void raise(const Real* value, Real* __restrict best, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        best[i] = value[i] > best[i] ? value[i] : best[i];
    }
}

template <class Real>
ISONEST_SIMD void raise_sum(const Real* a, const Real* b, Real* __restrict best, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        const Real sum = a[i] + b[i];
        best[i] = sum > best[i] ? sum : best[i];
    }
}

template <class Real>
ISONEST_SIMD void raise_by_four(const Real* a, const Real* b, const Real* c, const Real* d,
                                Real* __restrict best, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        best[i] = larger(best[i], larger(larger(a[i], b[i]), larger(c[i], d[i])));
    }
}

template <class Real>
ISONEST_SIMD void add_largest_of_four(const Real* a, const Real* b, const Real* c, const Real* d,
                                      Real* __restrict sum, std::int64_t n) {
    for (std::int64_t i = 0; i < n; ++i) {
        sum[i] += larger(larger(a[i], b[i]), larger(c[i], d[i]));
    }
}

template <class Real>
ISONEST_SIMD void midpoint_offsets(const Real* mid, const Real* a, const Real* b, Real* out,
                                   std::int64_t n, bool outward) {
    if constexpr (std::is_same_v<Real, double>) {
        if (outward) {
            midpoint_offsets_of<true>(mid, a, b, out, n);
            return;
        }
    }
    midpoint_offsets_of<false>(mid, a, b, out, n);
}

template <class Real>
ISONEST_SIMD void diagonal_offsets(const Real* mid, const Real* a, const Real* b,
                                   std::int64_t first, Real* out, std::int64_t n, bool outward) {
    if constexpr (std::is_same_v<Real, double>) {
        if (outward) {
            outward_diagonal_offsets_of(mid, a, b, first, out, n);
            return;
        }
    }
    diagonal_offsets_of(mid, a, b, first, out, n);
}

template <class Real, class Stored>
ISONEST_SIMD std::pair<Stored, Stored> round_up_row(const Real* in, Stored* __restrict out,
                                                    std::int64_t n) {
    // Numbers >= 0 have the same order as their bits, and integer operations may be reordered.
    using Bits = std::conditional_t<sizeof(Stored) == 4, std::uint32_t, std::uint16_t>;
    Bits low = std::numeric_limits<Bits>::max();
    Bits high = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        Stored stored{};
        round_up(in[i], stored);
        out[i] = stored;
        const Bits bits = std::bit_cast<Bits>(stored);
        low = bits < low ? bits : low;
        high = bits > high ? bits : high;
    }
    return {std::bit_cast<Stored>(low), std::bit_cast<Stored>(high)};
}

// NOLINTBEGIN(bugprone-macro-parentheses): Real is a type
#define ISONEST_INSTANTIATE(Real)                                                                  \
    template void differences(const Interpolation<Real>&, Real*, std::int64_t);                    \
    template void raise_differences(const Interpolation<Real>&, const Real*, Real*, std::int64_t); \
    template void raise(const Real*, Real*, std::int64_t);                                         \
    template void raise_sum(const Real*, const Real*, Real*, std::int64_t);                        \
    template void raise_by_four(const Real*, const Real*, const Real*, const Real*, Real*,         \
                                std::int64_t);                                                     \
    template void add_largest_of_four(const Real*, const Real*, const Real*, const Real*, Real*,   \
                                      std::int64_t);                                               \
    template void midpoint_offsets(const Real*, const Real*, const Real*, Real*, std::int64_t,     \
                                   bool);                                                          \
    template void diagonal_offsets(const Real*, const Real*, const Real*, std::int64_t, Real*,     \
                                   std::int64_t, bool);                                            \
    template std::pair<IndicatorCode, IndicatorCode> round_up_row(const Real*, IndicatorCode*,     \
                                                                  std::int64_t);                   \
    template std::pair<float, float> round_up_row(const Real*, float*, std::int64_t);
ISONEST_INSTANTIATE(float)
ISONEST_INSTANTIATE(double)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

}  // namespace isonest::detail
