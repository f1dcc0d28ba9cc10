// Fills a lattice with an indicator that no store holds.
#pragma once

#include <isonest/progress.h>

#include "query/study/computed_field.h"
#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// Sets the lattice's indicator at all refinement nodes that elements reach, those beyond the
/// volume too; +inf where the node or an end of its refinement edge is missing. Returns the largest
/// finite one. Saturation is that of section 5 of the paper: from fine to coarse, within a level
/// edges, faces, centres. The numbers are kept as float32 (nearest), so that a saturated one is at
/// least those that it covers. The same for any number of threads, which are the arena's. Throws
/// Error{cancelled}.
double compute_indicator(WholeLattice& whole, const ComputedField& field, const Double3& spacing,
                         Progress& progress);

}  // namespace isonest::detail
