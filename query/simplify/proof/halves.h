// Cutting a triangle in two.
#pragma once

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

inline Double3 centroid(const Triangle& t) {
    return {(t[0][0] + t[1][0] + t[2][0]) / 3, (t[0][1] + t[1][1] + t[2][1]) / 3,
            (t[0][2] + t[1][2] + t[2][2]) / 3};
}

/// Cut at the middle of the longest edge.
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

}  // namespace isonest::detail
