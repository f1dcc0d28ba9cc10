// The nodal fields that a store holds per level.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest {

/// Values, or an indicator with its saturation ("bar": maximum, "plus": sum; section 3 of the
/// paper).
enum class Field : std::uint8_t {
    values,
    linf_bar,      ///< eta_infinity, saturated by the maximum: an estimate
    linf_plus,     ///< eta_infinity, saturated by the sum: a bound, loose
    deviation_bar  ///< |U - U^l| over the node's support, saturated: a bound, nearly exact
};
inline constexpr int kFieldCount = 4;

/// The name in the store and on the command line.
std::string_view name_of(Field field);
std::optional<Field> field_from_name(std::string_view name);
/// All indicator fields, in the order of the store.
const std::vector<Field>& all_indicators();
/// "linf_bar, linf_plus": for messages.
std::string list_names(const std::vector<Field>& fields);

}  // namespace isonest
