#include "tools/python/src/fields.h"

#include <algorithm>
#include <optional>

#include <isonest/error.h>

namespace isonest::python {

Field field_of_name(const std::string& name) {
    const std::optional<Field> field = field_from_name(name);
    if (!field) {
        throw Error(ErrorKind::invalid_argument, "there is no field '" + name + "'",
                    {{RemedyKind::other_field, "values, " + list_names(all_fields())}});
    }
    return *field;
}

Field indicator_of_name(const std::string& name) {
    const std::optional<Field> field = field_from_name(name);
    if (!field || *field == Field::values) {
        throw Error(ErrorKind::invalid_argument, "there is no indicator '" + name + "'",
                    {{RemedyKind::other_field, list_names(all_fields())}});
    }
    return *field;
}

std::vector<Field> indicators_of_names(const std::vector<std::string>& names) {
    std::vector<Field> fields;
    for (const std::string& name : names) {
        const std::vector<Field> named = indicators_from_name(name);
        if (named.empty()) {
            throw Error(ErrorKind::invalid_argument, "there is no indicator '" + name + "'",
                        {{RemedyKind::other_field, "nodes, all, " + list_names(all_fields())}});
        }
        fields.insert(fields.end(), named.begin(), named.end());
    }
    std::sort(fields.begin(), fields.end());
    fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    return fields;
}

LengthUnit unit_of_name(const std::string& name) {
    const std::optional<LengthUnit> unit = length_unit_from(name);
    if (!unit) {
        throw Error(ErrorKind::invalid_argument, "there is no unit of length '" + name +
                                                     "'; there are " + list_of_length_units());
    }
    return *unit;
}

}  // namespace isonest::python
