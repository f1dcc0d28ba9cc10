// The distance of two graphs: of the data's and of the mesh's.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3, which names the distance of the graphs among
// the measures of the error. The point of a simplex that is nearest to a point: that of its affine
// hull where it lies inside, else one of a facet that separates the two.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// A point of a graph: along x, y, z (0 along flat axes), and the value.
using GraphPoint = std::array<double, 4>;

/// From a point to the nearest one of a simplex. REQUIRES: 1 to 4 vertices, affinely independent.
double distance_to_simplex(const GraphPoint& p, std::span<const GraphPoint> vertices);

/// The larger of two distances: the largest one from a point (x, U(x)) to the graph of P U, and
/// from a point (x, P U(x)) to the graph of U, x being the nodes of the finest lattice. Lengths are
/// relative to the volume's longest edge, values to `range`: so the data fill a unit cube. Missing
/// values belong to no graph. It looks at all nodes that can be the furthest, and for each at all
/// elements that can be nearest: its time grows with the error. The same for any number of threads,
/// which are the arena's. Throws Error{cancelled}. REQUIRES: the lattice's dimension is at least 1.
double graph_distance(const WholeLattice& whole, const Double3& spacing, double range,
                      Progress& progress);

}  // namespace isonest::detail
