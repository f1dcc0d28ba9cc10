// The diamond of a refinement node: the elements that share its refinement edge.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2. Elements are tetrahedra, or triangles or
// edges where axes of the lattice are flat.
#pragma once

#include <array>
#include <vector>

#include <isonest/int3.h>

#include "store/lattice/bisection.h"

namespace isonest::detail {

/// Whether `offset` is 0 along all flat axes (bits x, y, z).
bool in_flat_space(const Int3& offset, unsigned flat);

/// The vertices of t that differ from `node` along no flat axis, in the order of t.
std::vector<Int3> trace(const Tetrahedron& t, const Int3& node, unsigned flat);

/// The tetrahedra that refine at `node`, of the cubes with this edge around `cube`, and whose trace
/// is an element; cubes beside the flat space are left out. Several may have the same trace.
std::vector<Tetrahedron> tetrahedra_around(const Int3& cube, std::int64_t edge, const Int3& node,
                                           unsigned flat);

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

}  // namespace isonest::detail
