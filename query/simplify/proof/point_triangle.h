// The distance of a point from a triangle.
//
// Source: C. Ericson, "Real-Time Collision Detection" (2005), section 5.1.5: by the Voronoi region
// of the triangle's vertices, edges and inside that the point lies in.
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include <isonest/int3.h>

#include "store/base/vector3.h"

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

/// The square of the distance; of triangles without area, too. Never below the true one by more
/// than what double rounds.
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
    // Of a needle, rounding alone says where inside.
    constexpr double kNeedle = 1e-12;
    if (a > 0 && b > 0 && c > 0 && area > kNeedle * square(ab) * square(ac)) {
        // Inside: a point of the triangle, so that rounding makes the distance larger at most.
        return square(minus(p, along(along(t[0], b / area, ab), c / area, ac)));
    }
    // Seen from above, the nearest point is on an edge beyond which `p` lies.
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

}  // namespace isonest::detail
