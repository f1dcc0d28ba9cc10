#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <deque>
#include <map>
#include <mutex>
#include <shared_mutex>

#include <isonest/error.h>
#include <isonest/field.h>

namespace isonest {
namespace {

struct Description {
    std::string_view name;
    Indicator indicator;
    Saturation saturation;
    std::string_view stored = {};  ///< the name in a store, if it is another one
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
    {"normal_jump_bar", normal_jump, Saturation::bar, "normal_bar"},
    {"normal_jump_plus", normal_jump, Saturation::plus, "normal_plus"},
    {"normal_edge_bar", normal_edge, Saturation::bar},
    {"normal_edge_plus", normal_edge, Saturation::plus},
    {"normal_turn_bar", normal_turn, Saturation::bar},
    {"normal_turn_plus", normal_turn, Saturation::plus},
    {"normal_bar", normal, Saturation::bar, "normal_component_bar"},
    {"normal_plus", normal, Saturation::plus, "normal_component_plus"},
    {"hex_linf", hex_offset, Saturation::bar},
    {"hex_deviation", hex_offset, Saturation::plus},
}};

const Description& description_of(Field field) {
    return kFields.at(static_cast<std::size_t>(field));
}

std::string_view stored_name_of(const Description& field) {
    return field.stored.empty() ? field.name : field.stored;
}

constexpr std::array<std::string_view, 2> kSaturations{"_bar", "_plus"};

/// The names of own indicators that the process has met. Indicator i has the fields kFieldCount +
/// 2 i (bar) and the next (plus).
class OwnNames {
  public:
    std::size_t index_of(std::string_view name) {
        {
            const std::shared_lock lock(mutex_);
            if (const auto found = indices_.find(name); found != indices_.end()) {
                return found->second;
            }
        }
        const std::unique_lock lock(mutex_);
        if (const auto found = indices_.find(name); found != indices_.end()) {
            return found->second;
        }
        constexpr std::size_t kMost = 16384;
        if (indices_.size() == kMost) {
            throw Error(ErrorKind::limit,
                        fmt::format("more than {} names of own indicators in one process", kMost));
        }
        for (const std::string_view saturation : kSaturations) {
            names_.push_back(fmt::format("{}{}{}", kOwnPrefix, name, saturation));
        }
        return indices_.emplace(name, indices_.size()).first->second;
    }
    std::string_view name_of(std::size_t field) {
        const std::shared_lock lock(mutex_);
        return names_.at(field);  // a deque's elements stay where they are
    }

  private:
    std::shared_mutex mutex_;
    std::deque<std::string> names_;
    std::map<std::string, std::size_t, std::less<>> indices_;
};

OwnNames& own_names() {
    static OwnNames names;
    return names;
}

std::size_t own_number(Field field) {
    return static_cast<std::size_t>(field) - static_cast<std::size_t>(kFieldCount);
}

bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

bool is_own_name(std::string_view name) {
    constexpr std::size_t kLongest = 32;
    return !name.empty() && name.size() <= kLongest && is_letter(name.front()) &&
           std::all_of(name.begin(), name.end(), [](char c) {
               return is_letter(c) || (c >= '0' && c <= '9') || c == '-' || c == '_';
           });
}

/// The field with this name: one of the library, named by `name_in`, or an own indicator's.
template <class NameIn>
std::optional<Field> find_field(std::string_view name, const NameIn& name_in) {
    for (std::size_t s = 0; s < 2 && name.starts_with(kOwnPrefix); ++s) {
        if (name.ends_with(kSaturations[s])) {
            std::string_view own = name.substr(kOwnPrefix.size());
            own.remove_suffix(std::min(own.size(), kSaturations[s].size()));
            return is_own_name(own) ? std::optional(own_field(own, static_cast<Saturation>(s)))
                                    : std::nullopt;
        }
    }
    for (std::size_t i = 0; i < kFields.size(); ++i) {
        if (name_in(kFields[i]) == name) {
            return static_cast<Field>(i);
        }
    }
    return std::nullopt;
}

/// Whether a field had this name in the previous version, and no field has it now.
bool is_former(std::string_view name) {
    return name.starts_with("normal_component_");
}

}  // namespace

Field own_field(std::string_view name, Saturation saturation) {
    if (!is_own_name(name)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("'{}' cannot be the name of an indicator; it needs 1 to 32 letters "
                                "(a-z, A-Z), digits, '-' and '_', the first a letter",
                                name));
    }
    return static_cast<Field>(static_cast<std::size_t>(kFieldCount) +
                              2 * own_names().index_of(name) +
                              (saturation == Saturation::plus ? 1 : 0));
}

bool is_own(Field field) {
    return static_cast<int>(field) >= kFieldCount;
}

bool precedes(Field a, Field b) {
    return is_own(a) && is_own(b) ? name_of(a) < name_of(b) : a < b;
}

std::string_view name_of(Field field) {
    return is_own(field) ? own_names().name_of(own_number(field)) : description_of(field).name;
}

std::string_view stored_name_of(Field field) {
    return is_own(field) ? own_names().name_of(own_number(field))
                         : stored_name_of(description_of(field));
}

std::optional<Field> field_from_name(std::string_view name) {
    const auto found = find_field(name, [](const Description& d) { return d.name; });
    return found || !is_former(name) ? found : field_from_stored_name(name);
}

std::optional<Field> field_from_stored_name(std::string_view name) {
    return find_field(name, [](const Description& d) { return stored_name_of(d); });
}

std::string note_on_name(std::string_view name) {
    const std::optional<Field> field = field_from_name(name);
    if (field == Field::normal_bar || field == Field::normal_plus) {
        const std::string_view other =
            name_of(field_of(Indicator::normal_jump, saturation_of(*field)));
        return name == name_of(*field)
                   ? fmt::format(
                         "{} is now the paper's eta_N; the length of the whole jump, which had "
                         "this name before, is now {}",
                         name, other)
                   : fmt::format(
                         "{} is now called {}; the next version will not know its former "
                         "name",
                         name, name_of(*field));
    }
    return {};
}

Indicator indicator_of(Field field) {
    return is_own(field) ? Indicator::of_user : description_of(field).indicator;
}

Saturation saturation_of(Field field) {
    if (is_own(field)) {
        return own_number(field) % 2 == 0 ? Saturation::bar : Saturation::plus;
    }
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
    static const std::vector<Field> fields{Field::linf_plus, Field::deviation_bar};
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
