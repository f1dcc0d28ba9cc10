// Backface culling for a parallel view, of whole subtrees.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: an element whose descendants all face away
// need not be visited. The surface's normals point to smaller values, so it faces away from a
// viewer who looks along V where grad U . V <= 0. With beta_1 = eta_plus of |grad U_delta| the
// gradient of every descendant is within beta_1 of the element's; with beta_N = plus of the turn of
// the unit gradient (not of eta_N, see preprocess/indicators/normal_indicators.h) so are the
// normals.
#pragma once

#include <array>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "query/view/finest_indicators.h"
#include "query/view/topology.h"

namespace isonest::detail {

class Culling {
  public:
    /// `view`: the direction in which the viewer looks, world units, any length but 0. `field`:
    /// grad_linf_plus or normal_turn_plus, which bounds the change.
    Culling(const Double3& view, Field field, const Double3& spacing);

    [[nodiscard]] Field field() const {
        return by_normal_ ? Field::normal_turn_plus : Field::grad_linf_plus;
    }
    /// Whether all of the surface in the element and its descendants faces away. `beta`: the field
    /// at its refinement node; 0: the element alone. `stride`: of the lattice of the values.
    [[nodiscard]] bool faces_away(const CubeValues& values, const TopologyTetrahedron& t,
                                  unsigned mirror, std::int64_t stride, double beta) const;

  private:
    /// Of one tetrahedron of the tables in a cube of stride 1 that is not mirrored.
    struct Weights {
        /// Row i, times the value at vertex i + 1 less that at vertex 0, summed, is the gradient.
        std::array<Double3, 3> row{};
        double size = 0;  ///< of the longest row
    };
    bool by_normal_;
    std::array<Double3, 8> view_{};  ///< unit length, by the mirror of the cube
    std::array<Weights, kTopologySize> weights_{};
};

}  // namespace isonest::detail
