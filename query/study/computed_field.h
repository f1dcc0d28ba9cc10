// Indicators that no store holds, computed from the values of a volume in memory.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4, eta_p and eta_{1,p} for any p, and two
// quantities of section 3.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// d is the offset, the difference between the value at the node and the mean of the values at the
/// ends of its refinement edge.
enum class ComputedIndicator : std::uint8_t {
    lp,        ///< eta_p = |d| (sum of |T|)^(1/p) / (n + 1); |d| if p is infinite
    grad_lp,   ///< eta_{1,p} = |d| (integral of |grad hat|^p)^(1/p); |d| max |grad hat|
    gradient,  ///< |grad U| at the node, by central differences on the finest lattice
    curvature  ///< sqrt(k1^2 + k2^2) of the isosurface through the node, by the same; 0 where the
               ///< gradient is
};

struct ComputedField {
    ComputedIndicator indicator = ComputedIndicator::lp;
    double power = 1;                      ///< of lp and grad_lp: at least 1, or infinite
    std::optional<Saturation> saturation;  ///< nothing: as it is
};

/// "lp:3", "grad_lp:1.5_bar", "lp:inf_plus", "gradient", "curvature_bar".
std::optional<ComputedField> computed_field_from_name(std::string_view name);
std::string name_of(const ComputedField& field);

/// By what |d| is multiplied for lp and grad_lp, for each kind of refinement node.
class OffsetFactors {
  public:
    /// REQUIRES: the indicator is one of the two; the lattice's dimension is at least 1.
    OffsetFactors(const Lattice& lattice, const Double3& spacing, const ComputedField& field);

    /// REQUIRES: p is a refinement node of a cube that exists.
    [[nodiscard]] double of(const Int3& p, const NodeInfo& node) const;

  private:
    const Lattice& lattice_;
    double power_;
    bool gradient_;
    int dimension_;
    /// Per cube of edge 2 that touches a node of scale 1, by the bits of its odd axes: the size of
    /// the elements that refine there, and the integral of |grad hat|^p, or the largest |grad hat|.
    std::array<double, 8> size_{};
    std::array<double, 8> hat_{};
};

}  // namespace isonest::detail
