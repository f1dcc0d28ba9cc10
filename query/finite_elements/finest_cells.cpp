#include "query/finite_elements/finest_cells.h"

#include "store/base/vectors.h"

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

namespace {

ISONEST_SIMD
void add_weights_with_coefficient(const FinestTerms<float>& terms,
                                  const CornerRows<float>& stopping,
                                  const CornerRows<float>& active, const float* there,
                                  const EdgeRows<float>& edges,
                                  const std::array<SumRow<float>, 4>& mass) {
    add_weights<true>(terms, stopping, active, there, edges, mass);
}

ISONEST_SIMD
void add_weights_without(const FinestTerms<float>& terms, const CornerRows<float>& active,
                         const float* there, const EdgeRows<float>& edges,
                         const std::array<SumRow<float>, 4>& mass) {
    add_weights<false>(terms, active, active, there, edges, mass);
}

}  // namespace

void add_finest_weights(bool with_coefficient, const FinestTerms<float>& terms,
                        const CornerRows<float>& stopping, const CornerRows<float>& active,
                        const float* there, const EdgeRows<float>& edges,
                        const std::array<SumRow<float>, 4>& mass) {
    with_coefficient ? add_weights_with_coefficient(terms, stopping, active, there, edges, mass)
                     : add_weights_without(terms, active, there, edges, mass);
}

}  // namespace isonest::detail
