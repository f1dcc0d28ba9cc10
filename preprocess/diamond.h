// The diamond of a refinement node: the elements that share its refinement edge.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2. Elements are tetrahedra, or triangles or
// edges where axes of the lattice are flat.
#pragma once

#include <array>
#include <vector>

#include "store/int3.h"

namespace isonest {

/// One element that refines at the node, in half edges of the node's level, relative to the node.
struct DiamondElement {
    std::array<Int3, 4> v;  ///< v[0] and v[1] are the ends of the refinement edge
    int vertices = 4;
    Int3 cube;  ///< which cube (square, edge) of the level holds it, relative to the node's owner
};

/// The elements around the node in `slot` of a lattice node with these parities (bits x, y, z).
/// `flat`: bits of the flat axes, which must be 0 in parities and slot. Derived from explicit
/// bisection when first used. Thread-safe.
const std::vector<DiamondElement>& diamond(int slot, unsigned parities, unsigned flat);

}  // namespace isonest
