// The indicators of the unit gradient: how much the surface normal changes at a refinement.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4. eta_N(x) is the largest normal component of
// the jump of N = grad U / |grad U| over F_ref, the face between the two children of an element
// that refines at x: `component`. `jump` is the size of the whole jump, which is at least as large:
// the jump of grad U is normal to the face, but that of N is not, because N is scaled differently
// on the two sides. The paper gives no formula for eta_{N,e}; here it is the second difference
// along the refinement edge, 4 |U_delta| / h(e_ref), divided by the mean size of the children's
// gradients. None of these bounds the distance between a child's normal and its element's (the
// value at the midpoint may turn both children the same way). Therefore there is one more, the
// largest |N(child) - N(element)|, which is such a bound after summation over the levels.
#pragma once

#include <array>
#include <vector>

#include "preprocess/indicators/layer.h"
#include "store/base/vectors.h"

namespace isonest::detail {

/// The values around a node: x + 3 y + 9 z, from -1 to 1 half edges; the node has number 13.
using Neighbourhood = std::array<double, 27>;

struct NormalChange {
    double jump = 0;       ///< 0 to 2
    double edge = 0;       ///< eta_{N,e}, >= 0
    double turn = 0;       ///< 0 to 2
    double component = 0;  ///< eta_N, 0 to jump
};

/// For one level. If the gradient is 0 there is no normal, and N counts as 0.
class NormalIndicators {
  public:
    NormalIndicators(const LatticeSteps& steps, int level, unsigned flat);

    /// The indicators of the node in `slot` of lattice node `owner`; `cells` are the cells of its
    /// level. +inf if a value of the diamond is not finite. Thread-safe.
    [[nodiscard]] NormalChange at(const Int3& owner, int slot, const Int3& cells,
                                  const Neighbourhood& values) const;

  private:
    struct Element {
        std::array<std::uint8_t, 4>
            v{};  ///< index in the neighbourhood; v[0], v[1] are the ends of the refinement edge
        int vertices = 4;
        Int3 cube;
        std::array<Double3, 4> whole{};                    ///< gradient weights of the element
        std::array<std::array<Double3, 4>, 2> children{};  ///< in child i the node replaces v[i]
        Double3 across{};  ///< the unit normal of the face between the children
        double edge_length = 1;
    };
    std::array<std::vector<Element>, 8 * kSlots> tables_;
    unsigned flat_;
};

}  // namespace isonest::detail
