// Volume and gradient of a triangle's or tetrahedron's linear function, in world units.
#pragma once

#include <array>
#include <cmath>

#include <isonest/int3.h>

#include "store/base/vector3.h"

namespace isonest::detail {

/// An edge, triangle or tetrahedron along the axes that are not flat.
struct Simplex {
    std::array<Double3, 4> v{};
    int vertices = 4;
    unsigned flat = 0;  ///< bits of the axes along which all vertices agree

    /// Its length, area or volume.
    [[nodiscard]] double measure() const;
    /// Row i, times the value at vertex i, summed over i, is the gradient; 0 along flat axes.
    /// REQUIRES: measure() > 0.
    [[nodiscard]] std::array<Double3, 4> gradient_weights() const;
};

namespace simplex {

/// The edges from vertex 0 as rows, the flat axes' rows and columns being those of the identity.
inline std::array<Double3, 3> edge_matrix(const Simplex& s) {
    std::array<Double3, 3> m{};
    std::size_t vertex = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (((s.flat >> axis) & 1U) != 0) {
            m[axis][axis] = 1;
            continue;
        }
        for (std::size_t a = 0; a < 3; ++a) {
            m[axis][a] = s.v[vertex][a] - s.v[0][a];
        }
        ++vertex;
    }
    return m;
}

}  // namespace simplex

inline double Simplex::measure() const {
    const auto m = simplex::edge_matrix(*this);
    constexpr std::array<double, 5> kFactorial{1, 1, 1, 2, 6};
    return std::fabs(dot(m[0], cross(m[1], m[2]))) / kFactorial[static_cast<std::size_t>(vertices)];
}

inline std::array<Double3, 4> Simplex::gradient_weights() const {
    const auto m = simplex::edge_matrix(*this);
    const double det = dot(m[0], cross(m[1], m[2]));
    std::array<Double3, 4> weights{};
    std::size_t vertex = 1;
    for (std::size_t row = 0; row < 3; ++row) {
        if (((flat >> row) & 1U) != 0) {
            continue;
        }
        // A column of the inverse: the gradient of the function that is 1 at this vertex alone.
        const Double3 column = cross(m[(row + 1) % 3], m[(row + 2) % 3]);
        for (std::size_t a = 0; a < 3; ++a) {
            weights[vertex][a] = column[a] / det;
            weights[0][a] -= column[a] / det;
        }
        ++vertex;
    }
    return weights;
}

}  // namespace isonest::detail
