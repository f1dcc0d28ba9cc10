#include "tools/cli/options/fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include <isonest/error.h>

namespace isonest::detail::cli {

namespace {

[[noreturn]] void refuse(const std::string& option, const std::string& text, const char* first) {
    throw Error(ErrorKind::invalid_argument, fmt::format("{} '{}': there are {}{}", option, text,
                                                         first, list_names(all_fields())));
}

}  // namespace

Field parse_field(const std::string& option, const std::string& text) {
    const std::optional<Field> field = field_from_name(text);
    if (!field || *field == Field::values) {
        refuse(option, text, "");
    }
    return *field;
}

Field parse_field_or_values(const std::string& option, const std::string& text) {
    const std::optional<Field> field = field_from_name(text);
    if (!field) {
        refuse(option, text, "values, ");
    }
    return *field;
}

std::vector<Field> parse_indicators(const std::string& option, const std::string& text) {
    std::vector<Field> fields;
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string name = text.substr(begin, end - begin);
        const std::vector<Field> named = indicators_from_name(name);
        if (named.empty()) {
            refuse(option, name, "nodes, all, ");
        }
        fields.insert(fields.end(), named.begin(), named.end());
        begin = end + 1;
    }
    std::sort(fields.begin(), fields.end());
    fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    return fields;
}

}  // namespace isonest::detail::cli
