// The nodal fields that a store holds per level.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest {

/// What the number of a node measures before saturation (section 4 of the paper). x is the node,
/// U_delta(x) = U(x) - (U(x1) + U(x2)) / 2 with x1, x2 the ends of its refinement edge. U is the
/// finest function, U^l the linear one on the paper's grid T^l; l grows from coarse to fine, by one
/// per bisection, the other way than the levels of a store (preprocess/METHOD.md).
enum class Indicator : std::uint8_t {
    linf,       ///< eta_infinity = |U_delta|
    deviation,  ///< eta*_infinity: |U - U^l| over the support of x
    l1,         ///< eta_1 = |U_delta| sum |T| / (d + 1)
    l2,         ///< eta_2 = |U_delta| sqrt(sum |T|) / (d + 1)
    grad_linf,  ///< eta_{1,infinity} = max |grad U_delta|
    grad_l1,    ///< eta_{1,1}: the integral of |grad U_delta| over the support
    grad_l2,    ///< eta_{1,2}: the square root of the integral of |grad U_delta|^2 over the support
    grad_edge,  ///< eta_{1,e} = 2 |U_delta| / h(e_ref)
    normal_jump,  ///< the largest jump of grad U / |grad U| over F_ref, as a vector
    normal_edge,  ///< eta_{N,e}: the jump of the derivative along e_ref over |grad U|
    normal_turn,  ///< the largest change of grad U / |grad U| from an element to its children
    normal,       ///< eta_N: the largest component normal to F_ref of that jump
    /// For a hexahedral (quadrilateral) cell: the largest |U - U_C| over the nodes that refine it;
    /// U_C is d-linear between its corners.
    hex_offset,
    of_user,  ///< any indicator that a user of the library defined (own_field())
    normal_component [[deprecated("now called normal")]] = normal
};
/// Number of indicators of nodes that the library defines: all but hex_offset and of_user.
inline constexpr int kIndicatorCount = 12;

/// How a node covers its children: bar(x) = max(eta(x), max bar(c)), plus(x) = eta(x) + max
/// plus(c).
enum class Saturation : std::uint8_t { bar, plus };

/// The values, or an indicator with its saturation. Numbers from kFieldCount on stand for users'
/// own indicators, by name (own_field()); they have the same meaning in the whole process, but not
/// in another one.
enum class Field : std::uint16_t {
    values,
    linf_bar,       ///< an estimate
    linf_plus,      ///< a bound on |U - U^l|, loose
    deviation_bar,  ///< a bound on |U - U^l|, nearly exact
    deviation_plus,
    l1_bar,
    l1_plus,
    l2_bar,
    l2_plus,
    grad_linf_bar,
    grad_linf_plus,  ///< a bound on |grad U - grad U^l|
    grad_l1_bar,
    grad_l1_plus,
    grad_l2_bar,
    grad_l2_plus,
    grad_edge_bar,
    grad_edge_plus,
    normal_jump_bar,
    normal_jump_plus,
    normal_edge_bar,
    normal_edge_plus,
    normal_turn_bar,
    normal_turn_plus,  ///< a bound on |N - N^l|, N = grad U / |grad U|
    normal_bar,
    normal_plus,
    hex_linf,       ///< hex_offset with saturation bar: an estimate
    hex_deviation,  ///< hex_offset with saturation plus: a bound on |U - P|, P the projection on
                    ///< hexahedral cells
    normal_component_bar [[deprecated("now called normal_bar")]] = normal_bar,
    normal_component_plus [[deprecated("now called normal_plus")]] = normal_plus
};
/// Number of fields that the library defines.
inline constexpr int kFieldCount = 1 + 2 * kIndicatorCount + 2;

/// The name in C++, in Python and on the command line.
std::string_view name_of(Field field);
/// Also accepts the name of any own indicator, "own:NAME_bar", and former names; throws
/// Error{limit} for too many different own ones, like own_field().
std::optional<Field> field_from_name(std::string_view name);
/// One sentence on a name that had another meaning in the previous version, or on a former name;
/// empty for all others. Show it where a user gave the name.
std::string note_on_name(std::string_view name);
/// The name in a store, which never changes (store/FORMAT.md, section 4). It differs from name_of()
/// where an indicator was renamed.
std::string_view stored_name_of(Field field);
/// Inverse of stored_name_of(); otherwise like field_from_name().
std::optional<Field> field_from_stored_name(std::string_view name);
/// REQUIRES: field != values.
Indicator indicator_of(Field field);
Saturation saturation_of(Field field);
/// REQUIRES: indicator != of_user.
Field field_of(Indicator indicator, Saturation saturation);

// Own indicators: numbers of nodes that a user of the library defines (<isonest/own_indicator.h>).

/// What the names of their fields begin with.
inline constexpr std::string_view kOwnPrefix = "own:";
/// Largest number of own indicators in a store.
inline constexpr int kMaxOwnIndicators = 32;
/// The field "own:NAME_bar" or "own:NAME_plus" of the own indicator NAME: 1 to 32 letters (a-z,
/// A-Z), digits, '-' and '_', beginning with a letter. Throws Error{invalid_argument} for another
/// name, and Error{limit} for more than 16,384 different names in a process. Thread-safe.
Field own_field(std::string_view name, Saturation saturation);
bool is_own(Field field);
/// The order of fields in a store: those of the library in the order of the enumeration, then own
/// ones by the bytes of their names.
bool precedes(Field a, Field b);

/// The field from which `field` is derived at level 1. There the deviation is attained at nodes
/// that the element's own refinement reaches, so the deviation fields equal the fields of
/// eta_infinity. All other fields are their own source.
Field source_at_level_1(Field field);
/// Whether level 1 stores only the centres, because faces and edges follow from the values of level
/// 0 (query/values/brick_view.h).
bool centre_suffices_at_level_1(Field field);

/// Whether the field (or, for grad_linf_plus, the element's diameter h(T) times it) bounds |U -
/// U^l| in an element that refines at the node: section 5 of the paper, without its factor 1/2.
bool is_bound(Field field);

/// Whether the field has one number per hexahedral cell instead of one per node: hex_linf and
/// hex_deviation. In its saturation, the children of a cell are all cells of the next finer level
/// that share a node with it.
bool is_of_cells(Field field);

/// The fields that preprocess() computes by default.
const std::vector<Field>& default_indicators();
/// All indicator fields of nodes, in the order of the store.
const std::vector<Field>& node_indicators();
/// node_indicators(), followed by the fields of cells.
const std::vector<Field>& all_fields();
/// The indicator of that name; for `nodes`, node_indicators(); for `all`, all_fields(). Empty for
/// unknown names.
std::vector<Field> indicators_from_name(std::string_view name);
std::vector<std::string> names_of(const std::vector<Field>& fields);
/// "linf_bar, linf_plus": for messages.
std::string list_names(const std::vector<Field>& fields);

}  // namespace isonest
