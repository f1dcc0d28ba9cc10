// Names of fields in arguments.
#pragma once

#include <string>
#include <vector>

#include <isonest/field.h>

namespace isonest::python {

/// Throw Error{invalid_argument} listing the indicators that there are. The second removes
/// duplicates and sorts as a store does; "all" alone are those of preprocess --indicators all.
Field indicator_of_name(const std::string& name);
std::vector<Field> indicators_of_names(const std::vector<std::string>& names);
/// The same, or the values.
Field field_of_name(const std::string& name);

}  // namespace isonest::python
