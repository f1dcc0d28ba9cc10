// The distance of a point from a triangle.
//
// Source: C. Ericson, "Real-Time Collision Detection" (2005), section 5.1.5: by the Voronoi region
// of the triangle's vertices, edges and inside that the point lies in.
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include <isonest/int3.h>

#include "store/base/vectors.h"

namespace isonest::detail {

using Triangle = std::array<Double3, 3>;

inline Double3 point_at(const std::array<float, 3>& p) {
    return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}
inline Double3 minus(const Double3& a, const Double3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
/// a + t b.
inline Double3 along(const Double3& a, double t, const Double3& b) {
    return {a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]};
}
inline double square(const Double3& a) {
    return dot(a, a);
}

inline double square_distance_to_segment(const Double3& p, const Double3& a, const Double3& b) {
    const Double3 ab = minus(b, a);
    const double size = square(ab);
    const double t = size > 0 ? std::clamp(dot(minus(p, a), ab) / size, 0.0, 1.0) : 0;
    return square(minus(p, along(a, t, ab)));
}

/// The squared distance; also for triangles without area. It is never below the true one by more
/// than the rounding of double.
inline double square_distance(const Double3& p, const Triangle& t) {
    const Double3 ab = minus(t[1], t[0]);
    const Double3 ac = minus(t[2], t[0]);
    const Double3 ap = minus(p, t[0]);
    const double d1 = dot(ab, ap);
    const double d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) {
        return square(ap);
    }
    const Double3 bp = minus(p, t[1]);
    const double d3 = dot(ab, bp);
    const double d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) {
        return square(bp);
    }
    const Double3 cp = minus(p, t[2]);
    const double d5 = dot(ab, cp);
    const double d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) {
        return square(cp);
    }
    const double c = d1 * d4 - d3 * d2;
    const double b = d5 * d2 - d1 * d6;
    const double a = d3 * d6 - d5 * d4;
    const double area = a + b + c;
    // For a needle, the position inside would be determined by rounding alone.
    constexpr double kNeedle = 1e-12;
    if (a > 0 && b > 0 && c > 0 && area > kNeedle * square(ab) * square(ac)) {
        // Inside: the result is the distance to a point of the triangle, so rounding can only
        // increase it.
        return square(minus(p, along(along(t[0], b / area, ab), c / area, ac)));
    }
    // In projection, the nearest point is on an edge beyond which `p` lies.
    const bool is_needle = !(a <= 0 || b <= 0 || c <= 0);
    double least = std::numeric_limits<double>::infinity();
    if (c <= 0 || is_needle) {
        least = square_distance_to_segment(p, t[0], t[1]);
    }
    if (a <= 0 || is_needle) {
        least = std::min(least, square_distance_to_segment(p, t[1], t[2]));
    }
    if (b <= 0 || is_needle) {
        least = std::min(least, square_distance_to_segment(p, t[2], t[0]));
    }
    return least;
}

// Dividing a triangle in two.

inline Double3 centroid(const Triangle& t) {
    return {(t[0][0] + t[1][0] + t[2][0]) / 3, (t[0][1] + t[1][1] + t[2][1]) / 3,
            (t[0][2] + t[1][2] + t[2][2]) / 3};
}

/// Divides at the middle of the longest edge.
inline std::array<Triangle, 2> halves(const Triangle& t) {
    std::size_t longest = 0;
    double most = -1;
    for (std::size_t i = 0; i < 3; ++i) {
        if (const double size = square(minus(t[(i + 1) % 3], t[i])); size > most) {
            most = size;
            longest = i;
        }
    }
    const Double3& a = t[longest];
    const Double3& b = t[(longest + 1) % 3];
    const Double3& c = t[(longest + 2) % 3];
    const Double3 m{(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2};
    return {Triangle{a, m, c}, Triangle{m, b, c}};
}

// The distance of many points from one triangle: where the nearest point is inside, by the
// triangle's plane; otherwise as above, by the same source.

/// Data of a triangle for square_distance(), computed once.
class PreparedTriangle {
  public:
    explicit PreparedTriangle(const Triangle& t) : corners_(t) {
        const Double3 ab = minus(t[1], t[0]);
        const Double3 ac = minus(t[2], t[0]);
        const Double3 n = cross(ab, ac);
        // For a needle, the plane would be determined by rounding alone.
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

    /// The squared distance of `p`, as by square_distance(); may be infinity if it is above the
    /// limit.
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
    std::array<Double3, 3> out_{};  ///< of each edge, in the plane
    double far_side_ = 0;           ///< distance of the edge that does not contain the first corner
    bool is_needle_ = false;
};

}  // namespace isonest::detail
