// Names in arguments: of fields and of units.
#pragma once

#include <string>
#include <vector>

#include <isonest/field.h>
#include <isonest/length_unit.h>

namespace isonest::python {

/// Throws Error{invalid_argument} listing the indicators that there are.
Field indicator_of_name(const std::string& name);
/// Several, sorted as in a store, none twice; "nodes" and "all" are groups of them. Throws as
/// above.
std::vector<Field> indicators_of_names(const std::vector<std::string>& names);
/// The same, or the values.
Field field_of_name(const std::string& name);

/// Throws Error{invalid_argument}, which lists the units.
LengthUnit unit_of_name(const std::string& name);

}  // namespace isonest::python
