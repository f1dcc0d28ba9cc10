// Products and length of vectors in space.
#pragma once

#include <cmath>

#include <isonest/int3.h>

namespace isonest::detail {

inline double dot(const Double3& a, const Double3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline Double3 cross(const Double3& a, const Double3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline double length(const Double3& a) {
    return std::sqrt(dot(a, a));
}

}  // namespace isonest::detail
