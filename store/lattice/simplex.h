// Simplices: linear functions on them, and their bisection.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include <isonest/element.h>
#include <isonest/int3.h>

#include "store/base/vectors.h"

namespace isonest::detail {

/// For three vectors of the lattice: six times the volume of the tetrahedron that they span.
inline std::int64_t determinant(const Int3& a, const Int3& b, const Int3& c) {
    return a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) +
           a.z * (b.x * c.y - b.y * c.x);
}

// Volume and gradient of the linear function on a triangle or tetrahedron, in world units.

/// An edge, triangle or tetrahedron that extends along the axes that are not flat.
struct Simplex {
    std::array<Double3, 4> v{};
    int vertices = 4;
    unsigned flat = 0;  ///< bits of the axes along which all vertices have the same coordinate

    /// Its length, area or volume.
    [[nodiscard]] double measure() const;
    /// The gradient is the sum over i of row i times the value at vertex i; 0 along flat axes.
    /// REQUIRES: measure() > 0.
    [[nodiscard]] std::array<Double3, 4> gradient_weights() const;
};

namespace simplex {

/// The edges from vertex 0 as rows; the rows and columns of flat axes are those of the identity.
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
        // A column of the inverse: the gradient of the function that is 1 only at this vertex.
        const Double3 column = cross(m[(row + 1) % 3], m[(row + 2) % 3]);
        for (std::size_t a = 0; a < 3; ++a) {
            weights[vertex][a] = column[a] / det;
            weights[0][a] -= column[a] / det;
        }
        ++vertex;
    }
    return weights;
}

// Reflected Kuhn tetrahedra (isonest/element.h). Used to derive tables, never to traverse a volume.

/// A tetrahedron without values.
using Tetrahedron = Element<3>;

/// The axis orders of the six Kuhn tetrahedra. The position of a tetrahedron in this list is its
/// bit in the traversal's masks.
inline constexpr std::array<std::array<int, 3>, 6> kAxisOrders{
    {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}};

/// Kuhn tetrahedron `order` of the cube with index `cube` and the given edge, a power of two.
Tetrahedron kuhn_tetrahedron(const Int3& cube, std::int64_t edge, int order);

}  // namespace isonest::detail
