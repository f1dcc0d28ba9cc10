// The indicators that are a multiple of |U_delta|: norms of the hat function at the node.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4: eta_p, eta_{1,p} and eta_{1,e}. The hat's
// gradient is constant on each child of an element, and all elements around a node of one kind are
// mirror images of each other, so the factor depends on the kind, the spacing and the number of
// cubes around the node alone.
#pragma once

#include <array>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"

namespace isonest::detail {

/// Factors for one level. Thread-safe.
class OffsetNorms {
  public:
    /// World spacing of the finest lattice; `flat`: bits of the flat axes.
    OffsetNorms(const Double3& spacing, int level, unsigned flat);

    /// indicator / |U_delta| at a node of `slot` with `cubes` cubes (squares, edges) of the level
    /// around it: 1 for a centre, up to 4. REQUIRES: is_offset_norm(indicator).
    [[nodiscard]] double factor(Indicator indicator, int slot, int cubes) const;

    /// Whether the indicator is a multiple of |U_delta|.
    static bool is_offset_norm(Indicator indicator);

    /// Multiplies slots first to last of layer k, never rounding below the exact product.
    template <class Real>
    void scale(Indicator indicator, const LayerRange& range, std::int64_t k, int first, int last,
               Layer<Real>& layer) const;

  private:
    struct Slot {
        double volume = 0;     ///< of the elements in one cube
        double grad_linf = 0;  ///< of the hat of height 1
        double grad_l1 = 0;    ///< integral over one cube
        double grad_l2 = 0;    ///< integral of the square over one cube
        double edge_length = 1;
    };
    unsigned flat_;
    int dimension_;
    std::array<Slot, kSlots> slots_;
};

}  // namespace isonest::detail
