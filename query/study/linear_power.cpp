#include "query/study/linear_power.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace isonest::detail {
namespace {

constexpr std::size_t kMostValues = 4;

/// F(x) = sign(x)^n |x|^(p + n) / ((p + 1) .. (p + n)), whose n-th derivative is |x|^p.
class Antiderivative {
  public:
    Antiderivative(double power, std::size_t n) : n_(n), exponent_(power) {
        for (std::size_t i = 0; i < n; ++i) {
            exponent_ += 1;
            divisor_ *= exponent_;
        }
    }
    [[nodiscard]] double exponent() const { return exponent_; }
    /// F^(m)(x) / m!.
    [[nodiscard]] double derivative(double x, std::size_t m) const {
        double factor = 1;
        for (std::size_t i = 0; i < m; ++i) {
            factor *= (exponent_ - static_cast<double>(i)) / static_cast<double>(i + 1);
        }
        if (factor == 0) {
            return 0;
        }
        const double size = std::pow(std::fabs(x), exponent_ - static_cast<double>(m));
        const bool odd = (n_ + m) % 2 == 1;
        return factor / divisor_ * (odd && x < 0 ? -size : size);
    }

  private:
    std::size_t n_;
    double exponent_;
    double divisor_ = 1;
};

/// The divided difference of F at points near each other and far from 0, by Taylor's series about
/// their middle: the sum over j of F^(k + j)(c) / (k + j)! h_j(x - c), h_j the complete homogeneous
/// symmetric polynomials.
double near_difference(const Antiderivative& f, std::span<const double> x) {
    constexpr std::size_t kTerms = 28;
    const double middle = (x.front() + x.back()) / 2;
    std::array<double, kTerms> h{1};
    for (const double at : x) {
        for (std::size_t j = 1; j < kTerms; ++j) {
            h[j] += (at - middle) * h[j - 1];
        }
    }
    const std::size_t k = x.size() - 1;
    double sum = 0;
    double before = 1;
    for (std::size_t j = 0; j < kTerms; ++j) {
        const double term = h[j] == 0 ? 0 : f.derivative(middle, k + j) * h[j];
        sum += term;
        // Every second one is 0 where the points lie symmetrically.
        if (j > 1 && std::fabs(term) + std::fabs(before) < 1e-18 * std::fabs(sum)) {
            break;
        }
        before = term;
    }
    return sum;
}

/// REQUIRES: x is sorted.
double divided_difference(const Antiderivative& f, std::span<const double> x) {
    if (x.size() == 1) {
        return f.derivative(x[0], 0);
    }
    const double spread = x.back() - x.front();
    const double size = std::max(std::fabs(x.front()), std::fabs(x.back()));
    if (size == 0) {
        return 0;
    }
    if (spread * (1 + f.exponent()) <= size) {
        return near_difference(f, x);
    }
    return (divided_difference(f, x.last(x.size() - 1)) -
            divided_difference(f, x.first(x.size() - 1))) /
           spread;
}

}  // namespace

double mean_of_power(std::span<const double> values, double power) {
    const std::size_t count = values.size();
    std::array<double, kMostValues> x{};
    for (std::size_t i = 0; i < count; ++i) {  // sorted, by insertion
        std::size_t at = i;
        for (; at > 0 && x[at - 1] > values[i]; --at) {
            x[at] = x[at - 1];
        }
        x[at] = values[i];
    }
    const std::span<double> used(x.data(), count);
    const double size = std::max(std::fabs(used.front()), std::fabs(used.back()));
    if (size == 0) {
        return 0;
    }
    double sum = 0;
    double squares = 0;
    for (const double v : used) {
        sum += v;
        squares += v * v;
    }
    const auto n = static_cast<double>(count);
    if (power == 1 && (used.front() >= 0 || used.back() <= 0)) {
        return std::fabs(sum) / n;
    }
    if (power == 2) {
        return (squares + sum * sum) / (n * (n + 1));
    }
    double factorial = 1;
    for (std::size_t i = 0; i < count; ++i) {
        used[i] /= size;
        factorial *= i == 0 ? 1 : static_cast<double>(i);
    }
    const Antiderivative f(power, count - 1);
    return std::pow(size, power) * factorial * std::max(0.0, divided_difference(f, used));
}

}  // namespace isonest::detail
