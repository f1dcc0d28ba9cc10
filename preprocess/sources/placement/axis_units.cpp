#include "preprocess/sources/placement/axis_units.h"

#include <fmt/format.h>

#include <algorithm>

namespace isonest::detail {
namespace {

/// "x: um, z: none".
std::string text_of(const AxisUnits& axes) {
    std::string text;
    for (std::size_t a = 0; a < 3; ++a) {
        if (axes.at(a)) {
            text += fmt::format("{}{}: {:.40}", text.empty() ? "" : ", ", "xyz"[a],
                                axes.at(a)->empty() ? "none" : *axes.at(a));
        }
    }
    return text;
}

}  // namespace

std::optional<std::string> counted_unit(std::int64_t nodes, const std::string& said) {
    return nodes > 1 || length_unit_from(said) ? std::optional(said) : std::nullopt;
}

CommonUnit common_unit(const AxisUnits& axes) {
    CommonUnit common;
    if (std::none_of(axes.begin(), axes.end(),
                     [](const auto& axis) { return axis && !axis->empty(); })) {
        return common;
    }
    bool converted = false;
    for (std::size_t a = 0; a < 3; ++a) {
        if (!axes.at(a)) {
            continue;
        }
        const auto unit = length_unit_from(*axes.at(a));
        if (!unit) {
            return {.notes = {fmt::format("not all axes have a unit of length ({}): the unit of "
                                          "the spacing is not known",
                                          text_of(axes))}};
        }
        common.unit = common.unit.value_or(*unit);
        common.of_axis.at(a) = unit;
        converted = converted || unit != common.unit;
    }
    if (converted) {
        common.notes.push_back(
            fmt::format("the axes have different units ({}): all lengths are converted to {}",
                        text_of(axes), symbol_of(*common.unit)));
    }
    return common;
}

}  // namespace isonest::detail
