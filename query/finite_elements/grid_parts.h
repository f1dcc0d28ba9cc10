// What an ImplicitGrid consists of (<isonest/implicit_grid.h>), for the other classes on it.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/implicit_grid.h>
#include <isonest/int3.h>

#include "query/finite_elements/grid_blocks.h"
#include "store/base/workers.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

template <int D>
struct GridParts {
    Lattice lattice;
    Double3 spacing{1, 1, 1};
    int threads = 0;  ///< 0 = all
    NodeSet nodes;
    GridBlocks blocks;
    std::vector<ElementShape<D>> shapes;  ///< indexed as ShapeTable does
    mutable Workers workers;

    /// REQUIRES: the set was made by active_nodes(), lattice.dimension() == D.
    GridParts(const Lattice& on, const Double3& steps, NodeSet set, int thread_count);
};

/// All nodes of a lattice.
NodeSet every_node(const Lattice& lattice);

}  // namespace isonest::detail
