#include "query/study/true_error.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "query/study/finest_elements.h"
#include "query/study/linear_power.h"

namespace isonest::detail {

/// Over a part of the volume.
struct TrueError::Sums {
    double size = 0;
    double value = 0;
    double gradient = 0;
    double gradient_linf = 0;

    void add(const Sums& other) {
        size += other.size;
        value += other.value;
        gradient += other.gradient;
        gradient_linf = std::max(gradient_linf, other.gradient_linf);
    }
};

namespace {

/// U, or P U - U, at the nodes of an element.
template <int D>
std::array<double, D + 1> function_at(const WholeLattice& whole, const std::array<Int3, D + 1>& v,
                                      bool of_data) {
    std::array<double, D + 1> u{};
    for (std::size_t i = 0; i < v.size(); ++i) {
        u[i] = of_data ? whole.exact(v[i]) : whole.projected(v[i]) - whole.exact(v[i]);
    }
    return u;
}

/// Of a linear function: an element walks along one axis after another.
template <int D>
double gradient_length(const std::array<double, D + 1>& u, const AxisWalk<D>& walk,
                       const Double3& spacing) {
    double sum = 0;
    for (std::size_t i = 0; i < D; ++i) {
        const double slope = (u[i + 1] - u[i]) / spacing[walk.axes[i]];
        sum += slope * slope;
    }
    return std::sqrt(sum);
}

}  // namespace

TrueError::TrueError(const WholeLattice& whole, const Double3& spacing, double range, double power)
    : whole_(whole), spacing_(spacing), range_(range), power_(power) {
    const Sums data = integrate(true);
    size_ = data.size;
    gradient_ = data.gradient;
    gradient_linf_ = data.gradient_linf;
}

TrueNorms TrueError::measure() const {
    const Sums error = integrate(false);
    TrueNorms norms;
    norms.value = size_ > 0 ? std::pow(error.value / size_, 1 / power_) : 0;
    norms.gradient = gradient_ > 0 ? std::pow(error.gradient / gradient_, 1 / power_) : 0;
    norms.gradient_linf = gradient_linf_ > 0 ? error.gradient_linf / gradient_linf_ : 0;
    return norms;
}

/// `of_data`: of U in place of P U - U.
TrueError::Sums TrueError::integrate(bool of_data) const {
    switch (whole_.lattice().dimension()) {
        case 1:
            return integrate<1>(of_data);
        case 2:
            return integrate<2>(of_data);
        default:
            return integrate<3>(of_data);
    }
}

template <int D>
TrueError::Sums TrueError::integrate(bool of_data) const {
    const std::vector<AxisWalk<D>> walks = axis_walks<D>(whole_.lattice());
    const Int3 cells = max(whole_.lattice().nodes() - Int3{1, 1, 1}, {1, 1, 1});
    double size = 1;
    for (const std::size_t axis : walks.front().axes) {
        size *= spacing_[axis];
    }
    size /= static_cast<double>(walks.size());
    const auto in_cell = [&](const Int3& cell, Sums& sums) {
        for (const AxisWalk<D>& walk : walks) {
            const std::array<Int3, D + 1> v = finest_element<D>(cell, walk);
            std::array<double, D + 1> u = function_at<D>(whole_, v, of_data);
            if (std::all_of(u.begin(), u.end(), [](double e) { return e == 0; }) && !of_data) {
                continue;
            }
            if (!std::all_of(u.begin(), u.end(), [](double e) { return std::isfinite(e); })) {
                continue;
            }
            for (double& e : u) {
                e /= range_;
            }
            const double gradient = gradient_length<D>(u, walk, spacing_);
            sums.size += size;
            sums.value += of_data ? 0 : size * mean_of_power(u, power_);
            sums.gradient += size * std::pow(gradient, power_);
            sums.gradient_linf = std::max(sums.gradient_linf, gradient);
        }
    };
    // Row by row, so that the sums do not depend on who makes them.
    std::vector<Sums> rows(static_cast<std::size_t>(cells.y * cells.z));
    tbb::parallel_for(std::int64_t{0}, cells.y * cells.z, [&](std::int64_t row) {
        for (std::int64_t x = 0; x < cells.x; ++x) {
            in_cell({x, row % cells.y, row / cells.y}, rows[static_cast<std::size_t>(row)]);
        }
    });
    Sums sums;
    for (const Sums& row : rows) {
        sums.add(row);
    }
    return sums;
}

}  // namespace isonest::detail
