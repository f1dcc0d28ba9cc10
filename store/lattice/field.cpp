#include <array>

#include <isonest/field.h>

namespace isonest {
namespace {

struct Description {
    std::string_view name;
    Indicator indicator;
    Saturation saturation;
};
using enum Indicator;
constexpr std::array<Description, kFieldCount> kFields{{
    {"values", linf, Saturation::bar},
    {"linf_bar", linf, Saturation::bar},
    {"linf_plus", linf, Saturation::plus},
    {"deviation_bar", deviation, Saturation::bar},
    {"deviation_plus", deviation, Saturation::plus},
    {"l1_bar", l1, Saturation::bar},
    {"l1_plus", l1, Saturation::plus},
    {"l2_bar", l2, Saturation::bar},
    {"l2_plus", l2, Saturation::plus},
    {"grad_linf_bar", grad_linf, Saturation::bar},
    {"grad_linf_plus", grad_linf, Saturation::plus},
    {"grad_l1_bar", grad_l1, Saturation::bar},
    {"grad_l1_plus", grad_l1, Saturation::plus},
    {"grad_l2_bar", grad_l2, Saturation::bar},
    {"grad_l2_plus", grad_l2, Saturation::plus},
    {"grad_edge_bar", grad_edge, Saturation::bar},
    {"grad_edge_plus", grad_edge, Saturation::plus},
    {"normal_bar", normal, Saturation::bar},
    {"normal_plus", normal, Saturation::plus},
    {"normal_edge_bar", normal_edge, Saturation::bar},
    {"normal_edge_plus", normal_edge, Saturation::plus},
    {"normal_turn_bar", normal_turn, Saturation::bar},
    {"normal_turn_plus", normal_turn, Saturation::plus},
    {"normal_component_bar", normal_component, Saturation::bar},
    {"normal_component_plus", normal_component, Saturation::plus},
    {"hex_linf", hex_offset, Saturation::bar},
    {"hex_deviation", hex_offset, Saturation::plus},
}};

const Description& description_of(Field field) {
    return kFields.at(static_cast<std::size_t>(field));
}

}  // namespace

std::string_view name_of(Field field) {
    return description_of(field).name;
}

std::optional<Field> field_from_name(std::string_view name) {
    for (std::size_t i = 0; i < kFields.size(); ++i) {
        if (kFields[i].name == name) {
            return static_cast<Field>(i);
        }
    }
    return std::nullopt;
}

Indicator indicator_of(Field field) {
    return description_of(field).indicator;
}

Saturation saturation_of(Field field) {
    return description_of(field).saturation;
}

Field field_of(Indicator indicator, Saturation saturation) {
    std::size_t i = 1;
    while (kFields.at(i).indicator != indicator || kFields[i].saturation != saturation) {
        ++i;
    }
    return static_cast<Field>(i);
}

Field source_at_level_1(Field field) {
    return indicator_of(field) == deviation ? field_of(linf, saturation_of(field)) : field;
}

bool centre_suffices_at_level_1(Field field) {
    return indicator_of(field) == linf || indicator_of(field) == deviation;
}

bool is_bound(Field field) {
    return field == Field::linf_plus || field == Field::deviation_bar ||
           field == Field::deviation_plus || field == Field::grad_linf_plus;
}

bool is_of_cells(Field field) {
    return indicator_of(field) == hex_offset;
}

const std::vector<Field>& default_indicators() {
    static const std::vector<Field> fields{Field::linf_bar, Field::linf_plus, Field::deviation_bar};
    return fields;
}

const std::vector<Field>& node_indicators() {
    static const std::vector<Field> fields = [] {
        std::vector<Field> all;
        for (int i = 1; i < kFieldCount; ++i) {
            if (!is_of_cells(static_cast<Field>(i))) {
                all.push_back(static_cast<Field>(i));
            }
        }
        return all;
    }();
    return fields;
}

const std::vector<Field>& all_fields() {
    static const std::vector<Field> fields = [] {
        std::vector<Field> all = node_indicators();
        all.insert(all.end(), {Field::hex_linf, Field::hex_deviation});
        return all;
    }();
    return fields;
}

std::vector<Field> indicators_from_name(std::string_view name) {
    if (name == "nodes") {
        return node_indicators();
    }
    if (name == "all") {
        return all_fields();
    }
    const std::optional<Field> field = field_from_name(name);
    return field && *field != Field::values ? std::vector{*field} : std::vector<Field>{};
}

std::vector<std::string> names_of(const std::vector<Field>& fields) {
    std::vector<std::string> names;
    names.reserve(fields.size());
    for (const Field field : fields) {
        names.emplace_back(name_of(field));
    }
    return names;
}

std::string list_names(const std::vector<Field>& fields) {
    std::string text;
    for (const Field field : fields) {
        text += (text.empty() ? "" : ", ") + std::string(name_of(field));
    }
    return text;
}

}  // namespace isonest
