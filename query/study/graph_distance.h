// The distance between two graphs: those of the data and of the mesh.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3, which lists the distance of the graphs among
// the error measures. The nearest point of a simplex is that of its affine hull if it is inside the
// simplex, otherwise one of a facet that separates it from the given point.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// A point of a graph: x, y, z (0 along flat axes), and the value.
using GraphPoint = std::array<double, 4>;

/// Distance from a point to the nearest point of a simplex. REQUIRES: 1 to 4 vertices, affinely
/// independent.
double distance_to_simplex(const GraphPoint& p, std::span<const GraphPoint> vertices);

/// The larger of two distances: the largest distance from a point (x, U(x)) to the graph of P U,
/// and from a point (x, P U(x)) to the graph of U, where x are the nodes of the finest lattice.
/// Lengths are relative to the volume's longest edge, values to `range`: so the data fill a unit
/// cube. Missing values belong to no graph. All nodes that can be the furthest are examined, and
/// for each all elements that can be nearest, so the time grows with the error. The same for any
/// number of threads, which are the arena's. Throws Error{cancelled}. REQUIRES: the lattice's
/// dimension is at least 1.
double graph_distance(const WholeLattice& whole, const Double3& spacing, double range,
                      Progress& progress);

}  // namespace isonest::detail
