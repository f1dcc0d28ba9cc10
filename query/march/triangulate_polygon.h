// Triangulates a polygon by the diagonals whose lengths have the least sum.
//
// Source: G. Klincsek, "Minimal triangulations of polygonal domains", Annals of Discrete
// Mathematics 9 (1980).
#pragma once

#include <array>
#include <cstdint>
#include <limits>

namespace isonest::detail {

inline constexpr std::size_t kMostPolygonCorners = 24;

/// Corners 0 ... n - 1, each triangle in their order. `cost(i, j)`, i < j: of a diagonal; infinite
/// if it is forbidden. Calls triangle(i, j, k) for each triangle; false, and no call, if the
/// polygon cannot be triangulated by the diagonals that are allowed. Of equally good ones the
/// choice depends on n and the costs alone. REQUIRES: 3 <= n <= kMostPolygonCorners.
template <class Cost, class AddTriangle>
bool triangulate_polygon(std::size_t n, const Cost& cost, const AddTriangle& triangle) {
    if (n == 3) {
        triangle(0U, 1U, 2U);
        return true;
    }
    constexpr double kForbidden = std::numeric_limits<double>::infinity();
    // Of the part of the polygon between corners i and j: its diagonals but that one.
    std::array<std::array<double, kMostPolygonCorners>, kMostPolygonCorners> least;
    std::array<std::array<std::uint8_t, kMostPolygonCorners>, kMostPolygonCorners> apex;
    for (std::size_t i = 0; i + 1 < n; ++i) {
        least[i][i + 1] = 0;
    }
    for (std::size_t span = 2; span < n; ++span) {
        for (std::size_t i = 0; i + span < n; ++i) {
            const std::size_t j = i + span;
            least[i][j] = kForbidden;
            for (std::size_t k = i + 1; k < j; ++k) {
                double sum = least[i][k] + least[k][j];
                sum += k > i + 1 ? cost(i, k) : 0.0;
                sum += j > k + 1 ? cost(k, j) : 0.0;
                if (sum < least[i][j]) {
                    least[i][j] = sum;
                    apex[i][j] = static_cast<std::uint8_t>(k);
                }
            }
        }
    }
    if (!(least[0][n - 1] < kForbidden)) {
        return false;
    }
    std::array<std::array<std::uint8_t, 2>, kMostPolygonCorners> open;
    std::size_t count = 0;
    open[count++] = {0, static_cast<std::uint8_t>(n - 1)};
    while (count > 0) {
        const auto [i, j] = open[--count];
        const std::uint8_t k = apex[i][j];
        triangle(i, k, j);
        if (k > i + 1) {
            open[count++] = {i, k};
        }
        if (j > k + 1) {
            open[count++] = {k, j};
        }
    }
    return true;
}

}  // namespace isonest::detail
