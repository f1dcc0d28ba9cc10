// Indicators that are not stored, computed from the values of a whole volume.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4, eta_p and eta_{1,p} for any p, and the
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
/// refinement edge. U is the finest linear function, U^l the linear one on the elements that are
/// bisected at the node; S, the support, is their part of the volume.
enum class ComputedIndicator : std::uint8_t {
    lp,         ///< eta_p = |d| (sum of |T|)^(1/p) / (n + 1); |d| if p is infinite
    grad_lp,    ///< eta_{1,p} = |d| (integral of |grad hat|^p)^(1/p); |d| max |grad hat|
    gradient,   ///< |grad U| at the node, by central differences on the finest lattice
    curvature,  ///< sqrt(k1^2 + k2^2) of the isosurface through the node, by the same; 0 where the
                ///< gradient is
    graph_curvature,  ///< sqrt(k1^2 + k2^2) of the graph of U over a plane, by the same, with a
                      ///< unit of value as long as one of length; of all curvatures in a volume
    // Of hexahedral (quadrilateral) cells: U_delta is U at the nodes of a cell's refinement minus
    // the function that is d-linear between the cell's corners. Only for studies.
    hex_lp,       ///< its norm in L^p, with lumped mass; the largest |U_delta|
    hex_grad_lp,  ///< the norm of its gradient, by the corners of the cell's children; the largest
    // eta*(x), over the whole support: exact, but each takes the time of one pass over the volume
    // per bisection.
    deviation_lp,       ///< the norm of U - U^l in L^p(S); the largest |U - U^l|
    deviation_grad_lp,  ///< the norm of grad U - grad U^l in L^p(S); the largest
    deviation_graph     ///< the distance of the graphs of U and U^l over S, the larger of both
                        ///< directions, from the graphs' points over the nodes in S; in units in
                        ///< which the volume's longest edge and the range of U are 1
};

struct ComputedField {
    ComputedIndicator indicator = ComputedIndicator::lp;
    /// For indicators whose name ends with lp: at least 1, or infinite. For deviation_lp and
    /// deviation_grad_lp: at most 64, or infinite.
    double power = 1;
    std::optional<Saturation> saturation;  ///< nothing: not saturated
};

/// Names such as "lp:3", "grad_lp:1.5_bar", "lp:inf_plus", "gradient", "curvature_bar",
/// "deviation_grad_lp:2_bar", "deviation_graph".
std::optional<ComputedField> computed_field_from_name(std::string_view name);
std::string name_of(const ComputedField& field);

/// A field of the store, or one that is computed.
using AnyField = std::variant<Field, ComputedField>;
std::string name_of(const AnyField& field);

}  // namespace isonest
