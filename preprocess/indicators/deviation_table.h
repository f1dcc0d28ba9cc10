// What the deviation indicator of a node looks at: points, interpolation weights, finer cubes.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/int3.h>

namespace isonest::detail {

/// The support of one refinement node of level L, in units of the lattice of level L-2, relative to
/// the lattice node that owns it. Derived from explicit bisection, not written down.
struct DeviationSupport {
    struct Term {
        Int3 at;
        double weight;
    };
    /// A node of the support and the linear interpolation there by the tetrahedron that holds it.
    struct Point {
        Int3 at;
        std::vector<Term> terms;  ///< only those with a weight; empty for a vertex (difference 0)
    };
    /// A cube of level L-2 with tetrahedra inside the support, and which points are their vertices.
    struct Cube {
        Int3 low;
        std::vector<std::uint16_t> points;
    };
    std::vector<Point> points;
    std::vector<Cube> cubes;
};

/// The support of the node in `slot` of a lattice node whose coordinates have these parities.
/// `flat`: bits of the flat axes, 0 in slot; the support then is of triangles or edges, its cubes
/// squares or edges. Thread-safe; the tables are made once.
const DeviationSupport& deviation_support(int slot, int parity_x, int parity_y, int parity_z,
                                          unsigned flat);

}  // namespace isonest::detail
