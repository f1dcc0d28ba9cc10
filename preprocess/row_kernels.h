// The inner loops of the level pass over rows of numbers, compiled for several instruction sets.
#pragma once

#include <cstdint>

namespace isonest {

/// Differences between values and a linear interpolation of up to four others, one per lane:
/// |v[i] - sum of weight[t] * term[t][i]|.
template <class Real>
struct Interpolation {
    const Real* value = nullptr;
    const Real* term[4] = {};
    Real weight[4] = {};
    int terms = 0;  ///< 2 to 4
};

/// out[i] = difference. No aliasing between out and the inputs.
void differences(const Interpolation<float>& d, float* out, std::int64_t n);
void differences(const Interpolation<double>& d, double* out, std::int64_t n);

/// best[i] = max(best[i], difference + offset[i]); a sum that is NaN changes nothing.
void raise_differences(const Interpolation<float>& d, const float* offset, float* best,
                       std::int64_t n);
void raise_differences(const Interpolation<double>& d, const double* offset, double* best,
                       std::int64_t n);

/// best[i] = max(best[i], value[i]) and max(best[i], a[i] + b[i]); NaN changes nothing.
void raise(const float* value, float* best, std::int64_t n);
void raise(const double* value, double* best, std::int64_t n);
void raise_sum(const float* a, const float* b, float* best, std::int64_t n);
void raise_sum(const double* a, const double* b, double* best, std::int64_t n);

/// out[i] = the bits of the smallest binary32 >= in[i] that is 0 in the bits of `mask`, a number
/// 2^k - 1: 0 for a float, 0xFFFF for a 16-bit code in the upper half. REQUIRES: in[i] >= 0 or
/// +inf.
void round_up_row(const float* in, std::uint32_t* out, std::int64_t n, std::uint32_t mask);
void round_up_row(const double* in, std::uint32_t* out, std::int64_t n, std::uint32_t mask);

/// out[i] = the smallest binary32 >= in[i].
void round_up_row(const float* in, float* out, std::int64_t n);
void round_up_row(const double* in, float* out, std::int64_t n);

}  // namespace isonest
