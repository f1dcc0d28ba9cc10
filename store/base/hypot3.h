// The length of a vector by one formula, to the last bit the same with every standard library:
// std::hypot of three numbers is rounded otherwise in each.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace isonest::detail {

/// The square root of x^2 + y^2 + z^2, without overflow in between.
template <class T>
T hypot3(T x, T y, T z) {
    x = std::abs(x);
    y = std::abs(y);
    z = std::abs(z);
    const T largest = std::max(std::max(x, y), z);
    if (!(largest > 0 && largest < std::numeric_limits<T>::infinity())) {
        return x + y + z;  // 0, without end, or not a number
    }
    return largest * std::sqrt((x / largest) * (x / largest) + (y / largest) * (y / largest) +
                               (z / largest) * (z / largest));
}

}  // namespace isonest::detail
