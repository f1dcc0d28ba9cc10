// The names of indicators that are not stored.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/computed_field.h>

#include "query/study/support_measure.h"
#include "query/study/true_error.h"

namespace isonest {
namespace {

struct IndicatorName {
    std::string_view name;
    ComputedIndicator indicator;
};
constexpr std::array<IndicatorName, 10> kNames{
    {{"lp", ComputedIndicator::lp},
     {"grad_lp", ComputedIndicator::grad_lp},
     {"gradient", ComputedIndicator::gradient},
     {"curvature", ComputedIndicator::curvature},
     {"graph_curvature", ComputedIndicator::graph_curvature},
     {"hex_lp", ComputedIndicator::hex_lp},
     {"hex_grad_lp", ComputedIndicator::hex_grad_lp},
     {"deviation_lp", ComputedIndicator::deviation_lp},
     {"deviation_grad_lp", ComputedIndicator::deviation_grad_lp},
     {"deviation_graph", ComputedIndicator::deviation_graph}}};

bool has_power(ComputedIndicator indicator) {
    return indicator == ComputedIndicator::lp || indicator == ComputedIndicator::grad_lp ||
           indicator == ComputedIndicator::hex_lp || indicator == ComputedIndicator::hex_grad_lp ||
           indicator == ComputedIndicator::deviation_lp ||
           indicator == ComputedIndicator::deviation_grad_lp;
}

}  // namespace

std::optional<ComputedField> computed_field_from_name(std::string_view name) {
    ComputedField field;
    for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
        const std::string_view end = saturation == Saturation::bar ? "_bar" : "_plus";
        if (name.ends_with(end)) {
            field.saturation = saturation;
            name.remove_suffix(end.size());
            break;
        }
    }
    const std::size_t colon = name.find(':');
    const auto named = std::find_if(kNames.begin(), kNames.end(), [&](const IndicatorName& n) {
        return n.name == name.substr(0, colon) &&
               has_power(n.indicator) == (colon != std::string_view::npos);
    });
    if (named == kNames.end()) {
        return std::nullopt;
    }
    field.indicator = named->indicator;
    if (!has_power(field.indicator)) {
        return field;
    }
    name.remove_prefix(colon + 1);
    if (name == "inf") {
        field.power = std::numeric_limits<double>::infinity();
        return field;
    }
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), field.power);
    const bool is_number = error == std::errc() && end == name.data() + name.size();
    const double most = detail::measures_support(field.indicator)
                            ? detail::kMaxPower
                            : std::numeric_limits<double>::max();
    return is_number && field.power >= 1 && field.power <= most ? std::optional(field)
                                                                : std::nullopt;
}

std::string name_of(const ComputedField& field) {
    const auto named = std::find_if(kNames.begin(), kNames.end(), [&](const IndicatorName& n) {
        return n.indicator == field.indicator;
    });
    std::string name(named->name);
    if (has_power(field.indicator)) {
        name += fmt::format(":{}", field.power);
    }
    if (field.saturation) {
        name += *field.saturation == Saturation::bar ? "_bar" : "_plus";
    }
    return name;
}

std::string name_of(const AnyField& field) {
    const Field* const stored = std::get_if<Field>(&field);
    return stored != nullptr ? std::string(name_of(*stored))
                             : name_of(std::get<ComputedField>(field));
}

}  // namespace isonest
