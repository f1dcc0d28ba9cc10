// The mean of a power of a linear function over a simplex.
//
// Source: the formula of Hermite and Genocchi: the mean of F^(n) over a simplex of dimension n on
// which x is linear is n! times the divided difference of F at the values in its n + 1 vertices;
// C. de Boor, "Divided differences", Surveys in Approximation Theory 1 (2005).
#pragma once

#include <span>

namespace isonest::detail {

/// The mean of |x|^power over a simplex, x being linear on it with these values in its vertices.
/// Exact but for rounding (a relative error of about 1e-9), also where x changes its sign.
/// REQUIRES: 1 to 4 finite values, 1 <= power <= kMostPower. Thread-safe.
double mean_of_power(std::span<const double> values, double power);
inline constexpr double kMostPower = 64;

}  // namespace isonest::detail
