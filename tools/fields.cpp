#include "tools/fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "store/error.h"

namespace isonest::cli {

Field parse_field(const std::string& option, const std::string& text) {
    const std::optional<Field> field = field_from_name(text);
    if (!field || *field == Field::values) {
        throw Error(ErrorKind::invalid_argument, fmt::format("{} '{}': there are {}", option, text,
                                                             list_names(all_indicators())));
    }
    return *field;
}

std::vector<Field> parse_fields(const std::string& option, const std::string& text) {
    std::vector<Field> fields;
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        fields.push_back(parse_field(option, text.substr(begin, end - begin)));
        begin = end + 1;
    }
    return fields;
}

}  // namespace isonest::cli
