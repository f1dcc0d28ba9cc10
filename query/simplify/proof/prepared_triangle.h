// The distance of many points from one triangle: where the nearest point lies inside, from its
// plane; else as in query/simplify/proof/point_triangle.h, whose source holds here, too.
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

/// What square_distance() needs of a triangle, computed once.
class PreparedTriangle {
  public:
    explicit PreparedTriangle(const Triangle& t) : corners_(t) {
        const Double3 ab = minus(t[1], t[0]);
        const Double3 ac = minus(t[2], t[0]);
        const Double3 n = cross(ab, ac);
        // Of a needle, rounding alone says where its plane is.
        constexpr double kNeedle = 1e-6;
        const double size = square(n);
        is_needle_ = !(size > kNeedle * square(ab) * square(ac));
        if (is_needle_) {
            return;
        }
        up_ = scaled(n, size);
        const std::array<Double3, 3> edges{ab, minus(t[2], t[1]), minus(t[0], t[2])};
        for (std::size_t i = 0; i < 3; ++i) {
            const Double3 out = cross(edges[i], up_);
            out_[i] = scaled(out, square(out));
        }
        far_side_ = dot(out_[1], ab);
    }

    [[nodiscard]] const Triangle& corners() const { return corners_; }

    /// The square of the distance of `p`, as square_distance() has it; infinity is possible where
    /// it is above the limit.
    [[nodiscard]] double square_distance_within(const Double3& p, double limit) const {
        if (is_needle_) {
            return square_distance(p, corners_);
        }
        const Double3 q = minus(p, corners_[0]);
        const double height = dot(up_, q);
        const double beyond =
            std::max({dot(out_[0], q), dot(out_[1], q) - far_side_, dot(out_[2], q)});
        if (beyond <= 0) {
            return height * height;
        }
        constexpr double kRounding = 1 + 1e-9;
        if (std::max(beyond, std::fabs(height)) > limit * kRounding) {
            return std::numeric_limits<double>::infinity();
        }
        return square_distance(p, corners_);
    }

  private:
    static Double3 scaled(const Double3& a, double square_length) {
        const double by = 1 / std::sqrt(square_length);
        return {a[0] * by, a[1] * by, a[2] * by};
    }

    Triangle corners_;
    Double3 up_{};
    std::array<Double3, 3> out_{};  ///< of each edge, along the plane
    double far_side_ = 0;           ///< how far out the edge is that the first corner is not on
    bool is_needle_ = false;
};

}  // namespace isonest::detail
