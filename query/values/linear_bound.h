// A bound on the difference between a trilinear function and a linear function on a triangle.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "store/base/vectors.h"

namespace isonest::detail {

/// Computes the bound for one triangle after another. Not thread-safe.
///
/// The lattice's planes and the sides of the triangle's bounding box divide the box into pieces of
/// cells. In each piece, the trilinear function f is a weighted mean of its values at the piece's
/// eight corners; any affine function A is the mean of its own values with the same weights.
/// Therefore |f - A| on the triangle is at most its largest value at the corners of the pieces that
/// the triangle meets. The linear function L on the triangle can be extended to space by affine
/// functions A that differ in their slope across the triangle. Any of them gives a valid bound; the
/// slope is fitted to the corners.
class LinearBound {
  public:
    /// A bound on |f - L|; NaN if f is not finite at one of the corners. `triangle`: in steps of
    /// the lattice, inside it; `values`: of L at the triangle's corners; f(point): a finite number,
    /// or NaN; points are inside the triangle's box.
    template <class Function>
    [[nodiscard]] double of(const std::array<Double3, 3>& triangle,
                            const std::array<double, 3>& values, const Function& f);

  private:
    /// At most so many corners are kept for the fit.
    static constexpr std::size_t kMaxCorners = std::size_t{1} << 16U;
    /// The bound, or NaN if it is beyond the range of numbers.
    static double finite(double bound) {
        return std::isfinite(bound) ? bound : std::numeric_limits<double>::quiet_NaN();
    }
    /// Points x with direction . x <= most.
    struct HalfSpace {
        Double3 direction;
        double most;
    };
    struct Corner {
        double difference;  ///< f - A
        double height;      ///< above the triangle's plane
    };
    void enclose(const std::array<Double3, 3>& triangle, const Double3& direction);
    void set_box(const std::array<Double3, 3>& triangle);

    std::array<std::vector<double>, 3> planes_;  ///< along each axis, ascending
    std::vector<HalfSpace> half_spaces_;
    std::vector<Corner> corners_;
};

/// Adds the half space that contains all pieces of cells that the triangle meets.
inline void LinearBound::enclose(const std::array<Double3, 3>& triangle, const Double3& direction) {
    // Two points of a cell are at most one step apart along each axis.
    const double reach =
        std::fabs(direction[0]) + std::fabs(direction[1]) + std::fabs(direction[2]);
    double most = -std::numeric_limits<double>::infinity();
    for (const Double3& corner : triangle) {
        most = std::max(most, dot(direction, corner));
    }
    constexpr double kRounding = 1e-9;
    half_spaces_.push_back({direction, most + reach * (1 + kRounding)});
}

inline void LinearBound::set_box(const std::array<Double3, 3>& triangle) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto [least, most] =
            std::minmax({triangle[0][axis], triangle[1][axis], triangle[2][axis]});
        std::vector<double>& planes = planes_[axis];
        planes.assign(1, least);
        for (double plane = std::floor(least) + 1; plane < most; ++plane) {
            planes.push_back(plane);
        }
        if (least < most) {
            planes.push_back(most);
        }
    }
}

template <class Function>
double LinearBound::of(const std::array<Double3, 3>& triangle, const std::array<double, 3>& values,
                       const Function& f) {
    const auto minus = [](const Double3& a, const Double3& b) {
        return Double3{a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    };
    const Double3 e1 = minus(triangle[1], triangle[0]);
    const Double3 e2 = minus(triangle[2], triangle[0]);
    Double3 normal = cross(e1, e2);
    const double size = std::sqrt(dot(normal, normal));
    // A(x) = values[0] + slope . (x - triangle[0])
    Double3 slope{};
    half_spaces_.clear();
    if (size > 0) {
        normal = {normal[0] / size, normal[1] / size, normal[2] / size};
        const Double3 a = cross(e2, normal);
        const Double3 b = cross(normal, e1);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            slope[axis] =
                ((values[1] - values[0]) * a[axis] + (values[2] - values[0]) * b[axis]) / size;
        }
        enclose(triangle, normal);
        enclose(triangle, {-normal[0], -normal[1], -normal[2]});
        for (const Double3& edge : {e1, minus(e2, e1), Double3{-e2[0], -e2[1], -e2[2]}}) {
            enclose(triangle, cross(edge, normal));
        }
    }
    set_box(triangle);
    constexpr double kSlack = 1e-6;
    bool is_large = false;
    corners_.clear();
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    const std::vector<double>& xs = planes_[0];
    for (const double z : planes_[2]) {
        for (const double y : planes_[1]) {
            // The half spaces leave an interval of the row.
            double from = xs.front();
            double to = xs.back();
            for (const HalfSpace& h : half_spaces_) {
                constexpr double kParallel = 1e-12;
                const double left = h.most - h.direction[1] * y - h.direction[2] * z;
                if (h.direction[0] > kParallel) {
                    to = std::min(to, left / h.direction[0] + kSlack);
                } else if (h.direction[0] < -kParallel) {
                    from = std::max(from, left / h.direction[0] - kSlack);
                } else if (left < -kSlack) {
                    from = std::numeric_limits<double>::infinity();
                }
            }
            for (auto x = std::lower_bound(xs.begin(), xs.end(), from); x != xs.end() && *x <= to;
                 ++x) {
                const Double3 point{*x, y, z};
                const double value = f(point);
                if (!std::isfinite(value)) {
                    return std::numeric_limits<double>::quiet_NaN();
                }
                low = std::min(low, value);
                high = std::max(high, value);
                // For a triangle across many cells the range of values has to do.
                if (corners_.size() < kMaxCorners) {
                    const Double3 d = minus(point, triangle[0]);
                    corners_.push_back({value - values[0] - dot(slope, d), dot(normal, d)});
                } else {
                    is_large = true;
                }
            }
        }
    }
    // f lies between its values at the corners, L between those at the triangle's corners.
    const auto [least, most] = std::minmax({values[0], values[1], values[2]});
    const double by_range = finite(std::max(high - least, most - low));
    if (!(size > 0) || is_large) {
        return by_range;
    }
    double products = 0;
    double squares = 0;
    for (const Corner& corner : corners_) {
        products += corner.difference * corner.height;
        squares += corner.height * corner.height;
    }
    const double across = squares > 0 ? products / squares : 0;
    double worst = 0;
    for (const Corner& corner : corners_) {
        const double here = std::fabs(corner.difference - across * corner.height);
        worst = here <= worst ? worst : here;  // NaN stays
    }
    // How far A is from L at the triangle's corners, because of rounding.
    double rounding = 0;
    for (std::size_t i = 1; i < 3; ++i) {
        const Double3 d = minus(triangle[i], triangle[0]);
        const double at = dot(slope, d) + across * dot(normal, d);
        const double here = std::fabs(values[0] + at - values[i]);
        rounding = here <= rounding ? rounding : here;
    }
    // Of the arithmetic above, in which numbers as large as the values cancel.
    constexpr double kEpsilons = 64 * std::numeric_limits<double>::epsilon();
    const double arithmetic =
        kEpsilons *
        (std::max({std::fabs(low), std::fabs(high), std::fabs(least), std::fabs(most)}) + worst +
         rounding);
    const double fitted = worst + rounding + arithmetic;
    return std::isfinite(fitted) ? std::min(by_range + arithmetic, fitted) : by_range;
}

}  // namespace isonest::detail
