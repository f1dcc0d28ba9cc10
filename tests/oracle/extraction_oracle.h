// Adaptive extraction by explicit recursion, and the finest piecewise linear function: what meshes
// of the product are compared with.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4 (AdaptTraverse); marching tetrahedra.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/int3.h"
#include "tests/oracle/bisection_oracle.h"

namespace isonest::oracle {

/// A point or vector in coordinates of the finest lattice.
using Point = Double3;
/// Its normal (b - a) x (c - a) points toward smaller values.
using Triangle = std::array<Point, 3>;

struct Traversal {
    std::uint64_t visited = 0;  ///< tetrahedra put to the interest test
    std::uint64_t missing = 0;  ///< tetrahedra where the recursion ended that have a missing vertex
    std::vector<Simplex> leaves;  ///< the others where it ended: those to be marched
};

/// Skips t if iso is outside [min_T U - beta, max_T U + beta], beta = `bound` at its refinement
/// node (0 for the finest); refines it while it is not the finest and `stop` there is >= eps. A
/// tetrahedron with a missing vertex is never skipped.
Traversal adapt_traverse(const BisectionOracle& volume, const NodalField& stop,
                         const NodalField& bound, double eps, double iso);

/// Marches the tetrahedra; a node is inside if U >= iso. Every vertex of an edge of the grid has
/// the same bits in all tetrahedra around it. Where the surface passes exactly through nodes,
/// triangles with equal corners arise: see without_degenerate(). Tetrahedra with missing vertices
/// give nothing.
std::vector<Triangle> march(const BisectionOracle& volume, const std::vector<Simplex>& leaves,
                            double iso);

/// The triangles whose corners are three distinct points.
std::vector<Triangle> without_degenerate(const std::vector<Triangle>& triangles);
/// The parts inside the closed box, polygons cut into fans. Pieces in a face of the box stay.
std::vector<Triangle> clipped(const std::vector<Triangle>& triangles, const Point& lo,
                              const Point& hi);
/// Sum of the areas, in world units for the given node distances.
double area(const std::vector<Triangle>& triangles, const Double3& spacing = {1, 1, 1});
/// The distinct corners, sorted.
std::vector<Point> distinct_corners(const std::vector<Triangle>& triangles);

/// The finest piecewise linear function at p, coordinates outside the volume being clamped; NaN if
/// the smallest vertex, edge, face or tetrahedron of the finest grid that contains p has a missing
/// node.
double fine_value(const BisectionOracle& volume, const Point& p);

}  // namespace isonest::oracle
