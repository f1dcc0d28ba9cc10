// Conjugate gradients with Jacobi's preconditioner, for matrices that are only known by products.
//
// Source: M. R. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems",
// J. Res. Nat. Bur. Standards 49 (1952); the preconditioned form of Saad, "Iterative methods for
// sparse linear systems" (2003), algorithm 9.1.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include <isonest/progress.h>

#include "query/finite_elements/vector_sums.h"

namespace isonest::detail {

struct SolverReport {
    int iterations = 0;
    double residual = 0;  ///< sqrt(r . r / diagonal) in the end
};

/// The vectors of a solver; all of one size.
template <class Real>
struct SolverVectors {
    std::span<Real> x;  ///< in: the start; out: the solution
    std::span<Real> r;  ///< in: the right side less A x; out: what the recurrence leaves of it
    std::span<Real> p;  ///< scratch
    std::span<Real> z;  ///< scratch
};

/// Solves until sqrt(r . r / diagonal) <= tolerance, or `most` iterations are done. multiply(p, z):
/// z = A p, A symmetric and positive definite. The result is the same for any number of threads if
/// that of multiply is. Throws what multiply throws and Error{cancelled}.
template <class Real, class Multiply>
SolverReport conjugate_gradients(const Multiply& multiply, std::span<const Real> diagonal,
                                 const SolverVectors<Real>& v, double tolerance, int most,
                                 Progress& progress) {
    const std::span<Real> x = v.x;
    const std::span<Real> r = v.r;
    const std::span<Real> p = v.p;
    const std::span<Real> z = v.z;
    const std::size_t n = x.size();
    double rho = sum_of(n, [&](std::size_t i) {
        p[i] = r[i] / diagonal[i];
        return static_cast<double>(r[i]) * static_cast<double>(p[i]);
    });
    SolverReport report;
    for (; report.iterations < most && std::sqrt(rho) > tolerance; ++report.iterations) {
        progress.check();
        multiply(std::span<const Real>(p), z);
        const double curvature = sum_of(n, [&](std::size_t i) {
            return static_cast<double>(p[i]) * static_cast<double>(z[i]);
        });
        if (!(curvature > 0)) {
            break;  // what is left of r is rounding
        }
        const auto alpha = static_cast<Real>(rho / curvature);
        const double next = sum_of(n, [&](std::size_t i) {
            x[i] += alpha * p[i];
            r[i] -= alpha * z[i];
            return static_cast<double>(r[i]) * static_cast<double>(r[i]) /
                   static_cast<double>(diagonal[i]);
        });
        const auto beta = static_cast<Real>(next / rho);
        for_parts(n, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                p[i] = r[i] / diagonal[i] + beta * p[i];
            }
        });
        rho = next;
    }
    report.residual = std::sqrt(rho);
    return report;
}

}  // namespace isonest::detail
