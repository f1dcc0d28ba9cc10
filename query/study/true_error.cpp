#include "query/study/true_error.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMaxValues = 4;

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

/// The divided difference of F at points close to each other and far from 0, by Taylor's series
/// about their middle: the sum over j of F^(k + j)(c) / (k + j)! h_j(x - c), where h_j are the
/// complete homogeneous symmetric polynomials.
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
        // Every second term is 0 if the points are symmetric.
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
    std::array<double, kMaxValues> x{};
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

/// Sums over a part of the volume.
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

/// Gradient of a linear function: an element walks along one axis after another.
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

/// `of_data`: integrates U instead of P U - U.
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
    // Row by row, so that the sums do not depend on the distribution of work.
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

namespace {

/// Integrals over a part of the plane.
struct PlaneSums {
    double area = 0;
    double l1 = 0;
    double l2 = 0;
    double linf = 0;

    void add(const PlaneSums& other) {
        area += other.area;
        l1 += other.l1;
        l2 += other.l2;
        linf = std::max(linf, other.linf);
    }
};

/// A point of the plane on an edge of an element, and the error there.
struct Point {
    Double3 at{};
    double error = 0;
};

class Section {
  public:
    Section(const WholeLattice& whole, const LatticePlane& plane, const Double3& spacing,
            double range)
        : whole_(whole),
          plane_(plane),
          spacing_(spacing),
          range_(range),
          walks_(axis_walks<3>(whole.lattice())) {}

    /// Sums for the cells between the planes z and z + 1 of nodes.
    [[nodiscard]] PlaneSums layer(std::int64_t z) const {
        PlaneSums sums;
        for (std::int64_t y = 0; y + 1 < whole_.lattice().nodes().y; ++y) {
            const auto [first, end] = cut_in_row(y, z);
            for (std::int64_t x = first; x < end; ++x) {
                if (is_cut({x, y, z})) {
                    for (const AxisWalk<3>& walk : walks_) {
                        add(finest_element<3>({x, y, z}, walk), sums);
                    }
                }
            }
        }
        return sums;
    }

  private:
    /// A range (first, end) that contains all cells of a row that the plane cuts.
    [[nodiscard]] std::pair<std::int64_t, std::int64_t> cut_in_row(std::int64_t y,
                                                                   std::int64_t z) const {
        const std::int64_t cells = whole_.lattice().nodes().x - 1;
        const std::array<double, 4> at{plane_.distance({0, y, z}), plane_.distance({0, y + 1, z}),
                                       plane_.distance({0, y, z + 1}),
                                       plane_.distance({0, y + 1, z + 1})};
        const auto [low, high] = std::minmax_element(at.begin(), at.end());
        const double slope = plane_.normal[0];
        const double last = slope * static_cast<double>(cells);
        // Larger than the rounding error of the sums.
        const double margin = 1e-6 * (*high - *low + std::fabs(slope));
        if (*low + std::min(0.0, last) > margin || *high + std::max(0.0, last) < -margin) {
            return {0, 0};
        }
        if (std::fabs(last) <= *high - *low) {
            return {0, cells};
        }
        const auto crossing = [&](double distance) {
            return std::clamp(-distance / slope, -1.0, static_cast<double>(cells));
        };
        const double a = crossing(*low);
        const double b = crossing(*high);
        const double from = std::min(a, b);
        const double to = std::max(a, b);
        return {std::max<std::int64_t>(static_cast<std::int64_t>(std::floor(from)) - 1, 0),
                std::min(static_cast<std::int64_t>(std::ceil(to)) + 1, cells)};
    }
    [[nodiscard]] bool is_cut(const Int3& cell) const {
        bool below = false;
        bool not_below = false;
        for (std::int64_t i = 0; i < 8; ++i) {
            const double distance = plane_.distance(cell + Int3{2, 2, 2}.unlinear(i));
            (distance < 0 ? below : not_below) = true;
        }
        return below && not_below;
    }

    void add(const std::array<Int3, 4>& v, PlaneSums& sums) const {
        std::array<double, 4> distance{};
        std::array<double, 4> error{};
        std::array<std::size_t, 4> order{};  // those below come first
        std::size_t below = 0;
        std::size_t others = 4;
        for (std::size_t i = 0; i < 4; ++i) {
            distance[i] = plane_.distance(v[i]);
            order[distance[i] < 0 ? below++ : --others] = i;
        }
        if (below == 0 || below == 4) {
            return;
        }
        for (std::size_t i = 0; i < 4; ++i) {
            error[i] = (whole_.projected(v[i]) - whole_.exact(v[i])) / range_;
            if (!std::isfinite(error[i]) || !std::isfinite(whole_.exact(v[i]))) {
                return;
            }
        }
        const auto point = [&](std::size_t i, std::size_t j) {
            const double t = distance[i] / (distance[i] - distance[j]);
            Point p;
            for (int axis = 0; axis < 3; ++axis) {
                const auto from = static_cast<double>(v[i][axis]);
                const auto to = static_cast<double>(v[j][axis]);
                p.at[static_cast<std::size_t>(axis)] =
                    (from + t * (to - from)) * spacing_[static_cast<std::size_t>(axis)];
            }
            p.error = error[i] + t * (error[j] - error[i]);
            return p;
        };
        if (below != 2) {
            const std::size_t single = below == 1 ? order[0] : order[3];
            const std::size_t first = below == 1 ? 1 : 0;
            triangle(point(single, order[first]), point(single, order[first + 1]),
                     point(single, order[first + 2]), sums);
            return;
        }
        const Point a = point(order[0], order[2]);
        const Point c = point(order[1], order[3]);
        triangle(a, point(order[0], order[3]), c, sums);
        triangle(a, c, point(order[1], order[2]), sums);
    }

    static void triangle(const Point& a, const Point& b, const Point& c, PlaneSums& sums) {
        const auto edge = [&](const Point& to) {
            return Double3{to.at[0] - a.at[0], to.at[1] - a.at[1], to.at[2] - a.at[2]};
        };
        const double area = length(cross(edge(b), edge(c))) / 2;
        const std::array<double, 3> error{a.error, b.error, c.error};
        sums.area += area;
        sums.l1 += area * mean_of_power(error, 1);
        sums.l2 += area * mean_of_power(error, 2);
        for (const double e : error) {
            sums.linf = std::max(sums.linf, std::fabs(e));
        }
    }

    const WholeLattice& whole_;
    LatticePlane plane_;
    Double3 spacing_;
    double range_;
    std::vector<AxisWalk<3>> walks_;
};

}  // namespace

ErrorNorms plane_error(const WholeLattice& whole, const LatticePlane& plane, const Double3& spacing,
                       double range) {
    const Section section(whole, plane, spacing, range);
    std::vector<PlaneSums> layers(static_cast<std::size_t>(whole.lattice().nodes().z - 1));
    tbb::parallel_for(std::size_t{0}, layers.size(), [&](std::size_t z) {
        layers[z] = section.layer(static_cast<std::int64_t>(z));
    });
    PlaneSums sums;
    for (const PlaneSums& layer : layers) {
        sums.add(layer);
    }
    ErrorNorms norms;
    if (sums.area > 0) {
        norms.l1 = sums.l1 / sums.area;
        norms.l2 = std::sqrt(sums.l2 / sums.area);
        norms.linf = sums.linf;
    }
    return norms;
}

}  // namespace isonest::detail
