// Products in float64: not needed by the library, but by tests that compare its code with assembled
// matrices.
#include "query/finite_elements/grid_operator.h"
#include "query/finite_elements/grid_operator_template.h"

namespace isonest::detail {

template class GridOperator<double>;

}  // namespace isonest::detail
