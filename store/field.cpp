#include "store/field.h"

#include <array>

namespace isonest {
namespace {
constexpr std::array<std::string_view, kFieldCount> kNames{"values", "linf_bar", "linf_plus",
                                                           "deviation_bar"};
}

std::string_view name_of(Field field) {
    return kNames.at(static_cast<std::size_t>(field));
}

std::optional<Field> field_from_name(std::string_view name) {
    for (std::size_t i = 0; i < kNames.size(); ++i) {
        if (kNames[i] == name) {
            return static_cast<Field>(i);
        }
    }
    return std::nullopt;
}

const std::vector<Field>& all_indicators() {
    static const std::vector<Field> fields{Field::linf_bar, Field::linf_plus, Field::deviation_bar};
    return fields;
}

std::string list_names(const std::vector<Field>& fields) {
    std::string text;
    for (const Field field : fields) {
        text += (text.empty() ? "" : ", ") + std::string(name_of(field));
    }
    return text;
}

}  // namespace isonest
