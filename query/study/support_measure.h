// eta* of a node: the error of stopping there, measured over its whole support against the finest
// function.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3: the norms of the difference of the functions
// and of their gradients, and the distance of their graphs.
#pragma once

#include <functional>

#include <isonest/computed_field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/study/whole_lattice.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Whether it is one of the indicators defined here.
constexpr bool measures_support(ComputedIndicator indicator) {
    return indicator == ComputedIndicator::deviation_lp ||
           indicator == ComputedIndicator::deviation_grad_lp ||
           indicator == ComputedIndicator::deviation_graph;
}

/// eta*(p), for a refinement node p of a cube that exists: exact apart from rounding, and +inf if a
/// value in the support is missing. Thread-safe. Throws Error{cancelled}.
using SupportMeasure = std::function<double(const Int3& p, const NodeInfo& node)>;

/// The supports of one bisection cover the volume, so measuring them all takes as many passes over
/// the finest elements as there are bisections. REQUIRES: measures_support(field.indicator), with a
/// power as ComputedField says; `whole` and `progress` outlive the result.
SupportMeasure measure_of_support(const WholeLattice& whole, const ComputedField& field,
                                  const Double3& spacing, Progress& progress);

}  // namespace isonest::detail
