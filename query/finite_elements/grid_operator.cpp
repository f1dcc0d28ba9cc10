#include "query/finite_elements/grid_operator.h"

#include "query/finite_elements/grid_operator_template.h"

namespace isonest::detail {

template class GridOperator<float>;

}  // namespace isonest::detail
