#include "preprocess/sources/placement/axis_choice.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

[[noreturn]] void refuse(ErrorKind kind, std::span<const ArrayAxis> axes, const std::string& name,
                         const std::string& problem) {
    throw Error(kind, {name},
                fmt::format("{}; its axes (slowest first): {}", problem, text_of(axes)),
                {{RemedyKind::choose_index}});
}

std::string said(std::span<const ArrayAxis> axes, std::size_t i) {
    return axes[i].name.empty() ? fmt::format("axis {}", i)
                                : fmt::format("axis '{}'", axes[i].name);
}

/// For each axis the entry that is about it, or none.
std::vector<const AxisIndex*> entries_of(std::span<const ArrayAxis> axes,
                                         std::span<const AxisIndex> index,
                                         const std::string& name) {
    std::vector<const AxisIndex*> found(axes.size(), nullptr);
    const auto named = [](const AxisIndex& entry) { return !entry.axis.empty(); };
    if (std::none_of(index.begin(), index.end(), named)) {
        if (!index.empty() && index.size() != axes.size()) {
            refuse(ErrorKind::invalid_argument, axes, name,
                   fmt::format("the index has {} entries for {} axes", index.size(), axes.size()));
        }
        std::transform(index.begin(), index.end(), found.begin(),
                       [](const AxisIndex& entry) { return &entry; });
        return found;
    }
    for (const AxisIndex& entry : index) {
        const auto axis = std::find_if(axes.begin(), axes.end(), [&](const ArrayAxis& a) {
            return !a.name.empty() && a.name == entry.axis;
        });
        if (axis == axes.end()) {
            refuse(ErrorKind::invalid_argument, axes, name,
                   entry.axis.empty() ? std::string("the index names only some of its axes")
                                      : fmt::format("there is no axis '{}'", entry.axis));
        }
        const AxisIndex*& place = found[static_cast<std::size_t>(axis - axes.begin())];
        if (place != nullptr) {
            refuse(ErrorKind::invalid_argument, axes, name,
                   fmt::format("axis '{}' comes twice in the index", entry.axis));
        }
        place = &entry;
    }
    return found;
}

}  // namespace

std::string text_of(std::span<const ArrayAxis> axes) {
    std::string text;
    for (const ArrayAxis& axis : axes) {
        text += fmt::format("{}{}{}{}", text.empty() ? "" : ", ", axis.name,
                            axis.name.empty() ? "" : " ", axis.length);
    }
    return text;
}

ArrayPlace place_in_array(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                          const std::string& name, std::span<const std::uint64_t> strides) {
    constexpr std::uint64_t kMost = std::uint64_t{1} << 60U;
    ArrayPlace place;
    for (const ArrayAxis& axis : axes) {
        if (axis.length < 1 || static_cast<std::uint64_t>(axis.length) > kMost / place.whole) {
            throw Error(ErrorKind::corrupt, {name},
                        fmt::format("an array of [{}] values cannot be", text_of(axes)));
        }
        place.whole *= static_cast<std::uint64_t>(axis.length);
    }
    std::vector<std::uint64_t> steps(strides.begin(), strides.end());
    if (steps.empty()) {
        steps.assign(axes.size(), 1);
        for (std::size_t i = axes.size(); i-- > 1;) {
            steps[i - 1] = steps[i] * static_cast<std::uint64_t>(axes[i].length);
        }
    }
    const ChosenAxes chosen = choose_axes(axes, index, name);
    place.nodes = chosen.nodes;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        place.first += static_cast<std::uint64_t>(chosen.at[i]) * steps[i];
    }
    const Int3 n = chosen.nodes;
    const Int3 dense{1, n.x, n.x * n.y};
    Int3 stepped = dense;
    bool is_dense = true;
    for (int a = 0; a < 3; ++a) {
        if (const auto axis = chosen.axis.at(static_cast<std::size_t>(a)); axis && n[a] > 1) {
            stepped[a] = static_cast<std::int64_t>(steps[*axis]);
            is_dense = is_dense && stepped[a] == dense[a];
        }
    }
    if (!is_dense) {
        place.strides = stepped;
    }
    return place;
}

ChosenAxes choose_axes(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                       const std::string& name) {
    ChosenAxes chosen;
    chosen.at.assign(axes.size(), 0);
    const auto entries = entries_of(axes, index, name);
    std::vector<std::size_t> left;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const std::int64_t length = axes[i].length;
        const AxisIndex* const entry = entries[i];
        if (entry != nullptr && entry->at) {
            const std::int64_t at = *entry->at < 0 ? *entry->at + length : *entry->at;
            if (at < 0 || at >= length) {
                refuse(ErrorKind::invalid_argument, axes, name,
                       fmt::format("{} has no position {}", said(axes, i), *entry->at));
            }
            chosen.at[i] = at;
            continue;
        }
        if (!axes[i].of_volume) {
            if (length > 1) {
                refuse(ErrorKind::unsupported, axes, name,
                       fmt::format("{} is no place: a volume of one of its {} parts can be read",
                                   said(axes, i), length));
            }
            continue;
        }
        left.push_back(i);
    }
    if (left.size() > 3) {
        std::erase_if(left, [&](std::size_t i) { return axes[i].length == 1; });
    }
    if (left.size() > 3) {
        refuse(
            ErrorKind::unsupported, axes, name,
            fmt::format("{} axes: volumes of one scalar on at most 3 axes are read", left.size()));
    }
    std::reverse(left.begin(), left.end());
    for (std::size_t a = 0; a < left.size(); ++a) {
        chosen.axis.at(a) = left[a];
        chosen.nodes[static_cast<int>(a)] = axes[left[a]].length;
    }
    return chosen;
}

}  // namespace isonest::detail
