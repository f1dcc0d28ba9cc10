// Which nodes of a lattice are refined: those whose indicator is not below a threshold, and all
// that must be for the grid to have no hanging node and to end where the volume ends.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 4, 5 and 7. A node is active if bar(x) =
// max(eta(x), max bar(c)) >= threshold, c being the child nodes; so one bit for each node is
// enough. Where the volume does not end at a cube of a level, the elements that reach out of it are
// refined as well: elements outside are left out, all others lie in the volume.
#pragma once

#include <functional>
#include <span>

#include <isonest/field.h>
#include <isonest/progress.h>

#include "query/finite_elements/node_set.h"
#include "store/container/chunk_cache.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// eta_{1,infinity} of the hat function at a node: |grad| = factor * |U_delta|. `odd_axes`: bits of
/// the axes along which the node's refinement edge runs.
/// REQUIRES: level > 0, an odd axis, none of them flat.
double hat_gradient(const Lattice& lattice, const Double3& spacing, int level, unsigned odd_axes);

/// The refined nodes and the corners of the coarsest elements. `wanted`: whether the indicator,
/// saturated or not, is large enough at a refinement node of a level; called from many threads.
/// `threads`: 0 = all. Throws what `wanted` throws and Error{cancelled}.
NodeSet active_nodes(const Lattice& lattice,
                     const std::function<bool(const Int3& p, int level)>& wanted, int threads,
                     Progress& progress);

/// By eta_{1,infinity} (Field::grad_linf_bar) of the values of all nodes in memory, x fastest. A
/// threshold of 0 makes all nodes active. REQUIRES: they are finite; threshold >= 0.
template <class Real>
NodeSet active_nodes(const Lattice& lattice, const Double3& spacing, std::span<const Real> values,
                     double threshold, int threads, Progress& progress);

/// By a field of a store.
NodeSet active_nodes(ChunkCache& cache, Field field, double threshold, int threads,
                     Progress& progress);

}  // namespace isonest::detail
