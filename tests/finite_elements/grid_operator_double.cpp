// Products in float64, which the library does not need, as tests of its code against assembled
// matrices do.
#include "query/finite_elements/grid_operator.h"
#include "query/finite_elements/grid_operator_template.h"

namespace isonest::detail {

template class GridOperator<double>;

}  // namespace isonest::detail
