// The surface within one element of the nested grid: the triangles by which a leaf is drawn, with
// exact vertices.
#pragma once

#include <array>
#include <cstddef>

#include "query/march/finest_crossing.h"
#include "query/simplify/proof/point_triangle.h"
#include "query/traverse/element.h"

namespace isonest::detail {

using Barycentric = std::array<double, 4>;

/// Whether det(v1 - v0, v2 - v0, v3 - v0) > 0.
bool is_positive(const Element<3>& t);

/// No corner, or three, or four: then it is the triangles 0 1 2 and 0 2 3. As a set of points it is
/// what LocalMesh::march() makes of the element.
struct ElementPolygon {
    std::array<Double3, 4> at{};         ///< spacing times lattice coordinates
    std::array<Barycentric, 4> place{};  ///< the same in the element
    std::size_t count = 0;
    /// Whether there are corners of the element on both sides of the isovalue: then its neighbours
    /// have to know of it, if only to meet in a node or along an edge.
    bool is_crossed = false;

    [[nodiscard]] std::size_t triangles() const { return count == 0 ? 0 : count - 2; }
    [[nodiscard]] Triangle triangle(std::size_t i) const { return {at[0], at[i + 1], at[i + 2]}; }
};

/// REQUIRES: t.is_complete(). Without corners as well where the element's share is an edge or a
/// node alone. Throws what the crossing throws.
ElementPolygon element_polygon(const Element<3>& t, double iso, const Double3& spacing,
                               FinestCrossing& crossing);

}  // namespace isonest::detail
