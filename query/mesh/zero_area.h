// Triangles that have no area.
#pragma once

#include <array>
#include <cstddef>

namespace isonest::detail {

/// Whether the corners lie on a line, or some are equal.
inline bool has_no_area(const std::array<float, 3>& a, const std::array<float, 3>& b,
                        const std::array<float, 3>& c) {
    const auto d = [&a](const std::array<float, 3>& q, std::size_t i) {
        return static_cast<double>(q[i]) - static_cast<double>(a[i]);
    };
    const auto parallel = [&](std::size_t i, std::size_t j) {
        return d(b, i) * d(c, j) == d(b, j) * d(c, i);
    };
    return parallel(1, 2) && parallel(2, 0) && parallel(0, 1);
}

}  // namespace isonest::detail
