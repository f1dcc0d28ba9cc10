// The adaptive grid of hexahedra (quadrilaterals, edges) on a volume in memory, and P U on it.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 2: P U is U at the nodes that do not
// hang, and d-linear between the corners of a cell that is not refined.
#pragma once

#include <isonest/progress.h>

#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// Sets the lattice's indicator at the centres of the cells of all levels from 1 on to the cells'
/// numbers. Returns the largest finite one. The same for any number of threads, which are the
/// arena's. REQUIRES: is_of_cells(field); the store has it. Throws what ChunkCache throws, and
/// Error{cancelled}.
double load_cell_numbers(WholeLattice& whole, ChunkCache& cache, Field field, Progress& progress);

/// P U of the grid that refines the cells whose number is at least `threshold`, at all nodes.
/// Returns the number of the grid's nodes in the volume that do not hang. REQUIRES: the numbers of
/// cells are loaded.
std::uint64_t project_on_cells(WholeLattice& whole, double threshold);

/// The cells of that grid, those too that reach out of the volume.
VisitCounts count_cells(const WholeLattice& whole, double threshold);

}  // namespace isonest::detail
