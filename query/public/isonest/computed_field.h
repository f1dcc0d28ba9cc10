// Indicators that are not stored, computed from the values of a whole volume.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4, eta_p and eta_{1,p} for any p, and two
// quantities of section 3.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include <isonest/field.h>

namespace isonest {

/// d is the offset: the value at the node minus the mean of the values at the ends of its
/// refinement edge.
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
    std::optional<Saturation> saturation;  ///< nothing: not saturated
};

/// Names such as "lp:3", "grad_lp:1.5_bar", "lp:inf_plus", "gradient", "curvature_bar".
std::optional<ComputedField> computed_field_from_name(std::string_view name);
std::string name_of(const ComputedField& field);

/// A field of the store, or one that is computed.
using AnyField = std::variant<Field, ComputedField>;
std::string name_of(const AnyField& field);

}  // namespace isonest
