// Between functions on a lattice and functions on an implicit grid.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 3 and 7: the grid's function at a node that is
// not active is the mean of the two ends of its refinement edge.
#pragma once

#include <span>

#include "query/finite_elements/node_set.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The values at the active nodes of those at all nodes, x fastest. Both use the threads of the
/// arena that calls.
void restrict_to(const NodeSet& set, std::span<const float> all, std::span<float> active);

/// The function with these values at the active nodes, at all nodes of the lattice.
/// REQUIRES: the set is one that active_nodes() made.
void prolong(const Lattice& lattice, const NodeSet& set, std::span<const float> active,
             std::span<float> all);

}  // namespace isonest::detail
