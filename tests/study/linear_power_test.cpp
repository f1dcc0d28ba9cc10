// The mean of a power of a linear function, compared with sums over many points.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <vector>

#include "query/study/true_error.h"

using namespace isonest::detail;

namespace {

/// Sums over the midpoints of equal subdivisions of an edge, or over points of a triangle or
/// tetrahedron from a grid of weights.
double by_points(const std::vector<double>& x, double power) {
    const std::size_t n = x.size() - 1;
    const int steps = n == 1 ? 200000 : n == 2 ? 900 : 160;
    double sum = 0;
    double count = 0;
    const auto add = [&](double a, double b, double c) {
        const double rest = 1 - a - b - c;
        const double value =
            rest * x[0] + a * x[1] + (n > 1 ? b * x[2] : 0) + (n > 2 ? c * x[3] : 0);
        sum += std::pow(std::fabs(value), power);
        count += 1;
    };
    // Barycentric grids, shifted to the centres of cells: cells cut by the last face are omitted
    // symmetrically.
    const double h = 1.0 / steps;
    for (int i = 0; i < steps; ++i) {
        for (int j = 0; j < (n > 1 ? steps : 1); ++j) {
            for (int k = 0; k < (n > 2 ? steps : 1); ++k) {
                const double a = (i + 0.5) * h;
                const double b = n > 1 ? (j + 0.5) * h : 0;
                const double c = n > 2 ? (k + 0.5) * h : 0;
                if (a + b + c < 1) {
                    add(a, b, c);
                }
            }
        }
    }
    return sum / count;
}

}  // namespace

TEST_CASE("the mean of a power of a linear function agrees with a sum over many points") {
    std::mt19937 chance(3);
    std::uniform_real_distribution<double> any(-1, 1);
    for (std::size_t n = 1; n <= 3; ++n) {
        for (const double power : {1.0, 1.5, 2.0, 3.0, 4.7, 11.0}) {
            for (int i = 0; i < 4; ++i) {
                std::vector<double> x(n + 1);
                for (double& v : x) {
                    // Of both signs; of one sign; close together; some equal.
                    v = i == 0   ? any(chance)
                        : i == 1 ? 2 + any(chance)
                        : i == 2 ? 5 + 1e-4 * any(chance)
                                 : 0.5;
                }
                x[0] = i == 3 ? -0.25 : x[0];
                CAPTURE(n, power, i, x[0], x[1]);
                CHECK(mean_of_power(x, power) == Approx(by_points(x, power)).epsilon(0.02));
            }
        }
    }
}

TEST_CASE("even powers of linear functions agree with their closed forms") {
    std::mt19937 chance(5);
    std::uniform_real_distribution<double> any(-1, 1);
    for (int i = 0; i < 200; ++i) {
        // Spreads from 1 down to 1e-9 around 0.7, to cover all branches.
        const double spread = std::pow(10.0, -i % 10);
        std::array<double, 4> x{};
        for (double& v : x) {
            v = 0.7 * (i % 3) + spread * any(chance);
        }
        // The mean of x^4 is h_4(x) / C(7, 4), h_4 the sum of all products of four with repetition.
        double h = 0;
        for (std::size_t a = 0; a < 4; ++a) {
            for (std::size_t b = a; b < 4; ++b) {
                for (std::size_t c = b; c < 4; ++c) {
                    for (std::size_t d = c; d < 4; ++d) {
                        h += x[a] * x[b] * x[c] * x[d];
                    }
                }
            }
        }
        CHECK(mean_of_power(x, 4) == Approx(h / 35).epsilon(1e-9));
    }
}

TEST_CASE("the mean of a power of zeros is zero") {
    CHECK(mean_of_power(std::array<double, 3>{0, 0, 0}, 1.5) == 0);
    CHECK(mean_of_power(std::array<double, 2>{0, 1}, 1) == Approx(0.5));
    CHECK(mean_of_power(std::array<double, 2>{-1, 1}, 1) == Approx(0.5));
    CHECK(mean_of_power(std::array<double, 2>{-1, 1}, 64) == Approx(1.0 / 65));
}
