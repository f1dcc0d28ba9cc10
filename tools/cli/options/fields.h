// Names of fields in options.
#pragma once

#include <string>
#include <vector>

#include <isonest/field.h>

namespace isonest::detail::cli {

/// An indicator's field. Throws Error{invalid_argument} listing those there are.
Field parse_field(const std::string& option, const std::string& text);
/// The same, or the values.
Field parse_field_or_values(const std::string& option, const std::string& text);
/// Several indicators, with commas, and names of sets of them (indicators_from_name()); in the
/// store's order, each once. Throws as parse_field().
std::vector<Field> parse_indicators(const std::string& option, const std::string& text);

}  // namespace isonest::detail::cli
