#include "query/finite_elements/finest_cells.h"

#include "store/base/simd.h"

namespace isonest::detail {

ISONEST_SIMD
void add_finest_products(const FinestTerms<float>& terms, const CornerRows<float>& value,
                         const CornerRows<float>& active, const float* there,
                         const std::array<SumRow<float>, 4>& sums) {
    add_finest<ElementWork::stiffness, false>(terms, value, value, active, there, sums);
}

ISONEST_SIMD
void add_finest_products(const FinestTerms<float>& terms, const CornerRows<float>& value,
                         const CornerRows<float>& stopping, const CornerRows<float>& active,
                         const float* there, const std::array<SumRow<float>, 4>& sums) {
    add_finest<ElementWork::stiffness, true>(terms, value, stopping, active, there, sums);
}

}  // namespace isonest::detail
