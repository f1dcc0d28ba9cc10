// Indicators of hexahedral (quadrilateral) cells that are not stored, computed from the values of a
// volume in memory.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 4: eta_p and eta_{1,p}, transferred to
// cells that are refined into eight (four).
#pragma once

#include <isonest/computed_field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// Whether the indicator has one number per cell instead of one per node.
constexpr bool is_of_cells(ComputedIndicator indicator) {
    return indicator == ComputedIndicator::hex_lp || indicator == ComputedIndicator::hex_grad_lp;
}

/// Sets the lattice's indicator at the centres of the cells of all levels from 1 on; +inf where a
/// node of the cell's refinement is missing. The children of a cell are all cells of the next finer
/// level that share a node with it, as for Field::hex_linf. Returns the largest finite number. The
/// same for any number of threads, which are the arena's. Throws Error{cancelled}. REQUIRES:
/// is_of_cells(field.indicator).
double compute_cell_indicator(WholeLattice& whole, const ComputedField& field,
                              const Double3& spacing, Progress& progress);

}  // namespace isonest::detail
