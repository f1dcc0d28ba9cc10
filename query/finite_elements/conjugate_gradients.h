// Conjugate gradients with Jacobi's preconditioner, for matrices that are only known by products.
//
// Source: M. R. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems",
// J. Res. Nat. Bur. Standards 49 (1952); the preconditioned form of Saad, "Iterative methods for
// sparse linear systems" (2003), algorithm 9.1.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include <isonest/progress.h>

namespace isonest::detail {

// Parallel loops over long vectors, with sums that are the same for any number of threads.

inline constexpr std::size_t kVectorPart = 1U << 15U;

/// Calls f(begin, end) for parts of 0 .. size, from many threads.
template <class F>
void for_parts(std::size_t size, const F& f) {
    const std::size_t parts = (size + kVectorPart - 1) / kVectorPart;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, parts), [&](const auto& r) {
        for (std::size_t i = r.begin(); i < r.end(); ++i) {
            f(i * kVectorPart, std::min(size, (i + 1) * kVectorPart));
        }
    });
}

/// The sum of term(i), which may also modify data that belongs to i; summed in a fixed order.
template <class Term>
double sum_of(std::size_t size, const Term& term) {
    constexpr std::size_t kLanes = 8;
    std::vector<double> sums((size + kVectorPart - 1) / kVectorPart);
    for_parts(size, [&](std::size_t begin, std::size_t end) {
        std::array<double, kLanes> lane{};
        std::size_t i = begin;
        for (; i + kLanes <= end; i += kLanes) {
            for (std::size_t k = 0; k < kLanes; ++k) {
                lane[k] += term(i + k);
            }
        }
        for (; i < end; ++i) {
            lane[0] += term(i);
        }
        double sum = 0;
        for (const double part : lane) {
            sum += part;
        }
        sums[begin / kVectorPart] = sum;
    });
    double sum = 0;
    for (const double part : sums) {
        sum += part;
    }
    return sum;
}

struct SolverReport {
    int iterations = 0;
    double residual = 0;  ///< final sqrt(r . r / diagonal)
};

/// The vectors of a solver; all of one size.
template <class Real>
struct SolverVectors {
    std::span<Real> x;  ///< in: the initial value; out: the solution
    std::span<Real> r;  ///< in: the right-hand side minus A x; out: the residual of the recurrence
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
            break;  // the rest of r is rounding error
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
