#include "preprocess/sources/placement/axis_choice.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <string_view>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"

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
            return {
                .notes = {fmt::format(
                    "not all axes have a unit of length ({}); the unit of the spacing is unknown",
                    text_of(axes))}};
        }
        common.unit = common.unit.value_or(*unit);
        common.of_axis.at(a) = unit;
        converted = converted || unit != common.unit;
    }
    if (converted) {
        common.notes.push_back(
            fmt::format("the axes have different units ({}); all lengths are converted to {}",
                        text_of(axes), symbol_of(*common.unit)));
    }
    return common;
}

namespace {

/// For each axis its entry in the index; null if there is none.
using Entries = std::vector<const AxisIndex*>;

/// Synonyms: they mean the same axis if a file has only one of them.
constexpr std::array<std::array<std::string_view, 6>, 2> kSynonyms{
    {{"t", "time", "times", "frame", "frames", ""},
     {"c", "channel", "channels", "component", "components", "sample"}}};

/// The row of kSynonyms that contains a name in lower case; none if it has no synonyms.
std::optional<std::size_t> synonyms_of(const std::string& name) {
    for (std::size_t row = 0; row < kSynonyms.size(); ++row) {
        const auto& names = kSynonyms.at(row);
        if (!name.empty() && std::find(names.begin(), names.end(), name) != names.end()) {
            return row;
        }
    }
    return std::nullopt;
}

/// The number of an axis, if it is named by number; none for other names.
std::optional<std::int64_t> number_of(const std::string& name) {
    std::int64_t number = 0;
    const char* const end = name.data() + name.size();
    const auto [at, error] = std::from_chars(name.data(), end, number);
    return error == std::errc{} && at == end && !name.empty() ? std::optional(number)
                                                              : std::nullopt;
}

/// All axes that a name can mean; several if it is ambiguous.
std::vector<std::size_t> axes_of_name(std::span<const ArrayAxis> axes, const std::string& name) {
    const auto matching = [&](const auto& matches) {
        std::vector<std::size_t> found;
        for (std::size_t i = 0; i < axes.size(); ++i) {
            if (!axes[i].name.empty() && matches(axes[i].name)) {
                found.push_back(i);
            }
        }
        return found;
    };
    auto found = matching([&](const std::string& own) { return own == name; });
    if (found.empty()) {
        found = matching([&](const std::string& own) { return lower(own) == lower(name); });
    }
    if (const auto row = synonyms_of(lower(name)); found.empty() && row) {
        found = matching([&](const std::string& own) { return synonyms_of(lower(own)) == row; });
    }
    if (const auto number = number_of(name); found.empty() && number) {
        const auto count = static_cast<std::int64_t>(axes.size());
        const std::int64_t i = *number < 0 ? *number + count : *number;
        if (i >= 0 && i < count) {
            found.push_back(static_cast<std::size_t>(i));
        }
    }
    return found;
}

/// The name of an axis in an index: its own if that is plain and unique, otherwise its number.
std::string index_name(std::span<const ArrayAxis> axes, std::size_t i) {
    const std::string& own = axes[i].name;
    const bool plain = std::all_of(own.begin(), own.end(), [](unsigned char c) {
        return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.';
    });
    return plain && !own.empty() && axes_of_name(axes, own) == std::vector{i}
               ? own
               : fmt::format("{}", i);
}

bool is_whole(const AxisIndex* entry) {
    return entry != nullptr && !entry->at;
}

/// Valid indices to propose: position 0 on axes that need a position; if that is a single axis
/// which may also be selected as a whole, that, too.
std::vector<Remedy> proposals(std::span<const ArrayAxis> axes, const Entries& entries) {
    std::vector<std::size_t> chosen;
    std::vector<std::size_t> left;
    std::string given;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const AxisIndex* const entry = entries.empty() ? nullptr : entries[i];
        if (entry != nullptr && entry->at) {
            given += fmt::format("{}={},", index_name(axes, i), *entry->at);
        } else if (axes[i].length > 1) {
            (axes[i].of_volume || is_whole(entry) ? left : chosen).push_back(i);
        }
    }
    const bool may_be_whole = chosen.size() == 1 && left.size() < 3;
    // Too many axes: fix first those named as times or channels, then the slowest; last those that
    // the caller wants as a whole.
    const auto rank = [&](std::size_t i) {
        return std::pair(!entries.empty() && is_whole(entries[i]),
                         !synonyms_of(lower(axes[i].name)).has_value());
    };
    std::stable_sort(left.begin(), left.end(),
                     [&](std::size_t a, std::size_t b) { return rank(a) < rank(b); });
    for (std::size_t i = 0; i + 3 < left.size(); ++i) {
        chosen.push_back(left[i]);
    }
    std::sort(chosen.begin(), chosen.end());
    std::string positions;
    for (const std::size_t i : chosen) {
        positions += fmt::format("{}{}=0", positions.empty() ? "" : ",", index_name(axes, i));
    }
    std::vector<Remedy> remedies{
        {RemedyKind::choose_index, positions.empty() ? "" : given + positions}};
    if (may_be_whole) {
        remedies.push_back(
            {RemedyKind::choose_index, fmt::format("{}{}=:", given, index_name(axes, chosen[0]))});
    }
    return remedies;
}

[[noreturn]] void refuse(ErrorKind kind, std::span<const ArrayAxis> axes, const std::string& name,
                         const std::string& problem, const Entries& entries = {}) {
    throw Error(kind, {name},
                fmt::format("{}; its axes (slowest first): {}", problem, text_of(axes)),
                proposals(axes, entries));
}

std::string said(std::span<const ArrayAxis> axes, std::size_t i) {
    return axes[i].name.empty() ? fmt::format("axis {}", i)
                                : fmt::format("axis '{}'", axes[i].name);
}

Entries entries_of(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                   const std::string& name) {
    Entries found(axes.size(), nullptr);
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
        if (entry.axis.empty()) {
            refuse(ErrorKind::invalid_argument, axes, name,
                   "the index must name all of its axes, or none", found);
        }
        const std::vector<std::size_t> meant = axes_of_name(axes, entry.axis);
        if (meant.size() != 1) {
            refuse(ErrorKind::invalid_argument, axes, name,
                   meant.empty()
                       ? fmt::format("there is no axis '{}'", entry.axis)
                       : fmt::format(
                             "'{}' is the name of {} axes; give the number of one instead, from 0",
                             entry.axis, meant.size()),
                   found);
        }
        const AxisIndex*& place = found[meant[0]];
        if (place != nullptr) {
            refuse(ErrorKind::invalid_argument, axes, name,
                   fmt::format("the index has {} twice", said(axes, meant[0])));
        }
        place = &entry;
    }
    return found;
}

/// "along axis 't'", "along axis 't' and axis 'c'"
std::string along(std::span<const ArrayAxis> axes, const std::vector<std::size_t>& some) {
    std::string text;
    for (const std::size_t i : some) {
        text += fmt::format("{}{}", text.empty() ? "along " : " and ", said(axes, i));
    }
    return text;
}

}  // namespace

bool is_time_name(const std::string& name) {
    return synonyms_of(lower(name)) == std::size_t{0} || lower(name).ends_with("time");
}

std::optional<std::size_t> time_axis(std::span<const ArrayAxis> axes, const ChosenAxes& chosen) {
    std::optional<std::size_t> found;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const bool is_whole = std::find(chosen.axis.begin(), chosen.axis.end(), std::optional(i)) !=
                              chosen.axis.end();
        if (is_time_name(axes[i].name) && (axes[i].length == 1 || !is_whole)) {
            if (found) {
                return std::nullopt;
            }
            found = i;
        }
    }
    return found;
}

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
    constexpr std::uint64_t kMax = std::uint64_t{1} << 60U;
    ArrayPlace place;
    for (const ArrayAxis& axis : axes) {
        if (axis.length < 1 || static_cast<std::uint64_t>(axis.length) > kMax / place.whole) {
            throw Error(ErrorKind::corrupt, {name},
                        fmt::format("an array cannot have the shape [{}]", text_of(axes)));
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
    const Entries entries = entries_of(axes, index, name);
    std::vector<std::size_t> left;
    std::vector<std::size_t> unchosen;
    double volumes = 1;
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
        } else if (axes[i].of_volume || is_whole(entry)) {
            left.push_back(i);
        } else if (length > 1) {
            unchosen.push_back(i);
            volumes *= static_cast<double>(length);
        }
    }
    if (!unchosen.empty()) {
        refuse(
            ErrorKind::unsupported, axes, name,
            fmt::format("there are {:.0f} volumes {}; choose one", volumes, along(axes, unchosen)),
            entries);
    }
    if (left.size() > 3) {
        std::erase_if(left, [&](std::size_t i) { return axes[i].length == 1; });
    }
    if (left.size() > 3) {
        refuse(ErrorKind::unsupported, axes, name,
               fmt::format("there are {} axes, but a volume has at most 3", left.size()), entries);
    }
    std::reverse(left.begin(), left.end());
    for (std::size_t a = 0; a < left.size(); ++a) {
        chosen.axis.at(a) = left[a];
        chosen.nodes[static_cast<int>(a)] = axes[left[a]].length;
        chosen.no_space.at(a) = !axes[left[a]].of_volume && axes[left[a]].length > 1;
    }
    return chosen;
}

std::vector<std::string> notes_of(const ChosenAxes& chosen, std::span<const ArrayAxis> axes,
                                  const std::optional<Double3>& apart) {
    std::vector<std::string> notes;
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.no_space.at(a)) {
            notes.push_back(fmt::format(
                "{} is not a direction in space; it is used as {}{}",
                said(axes, *chosen.axis.at(a)), "xyz"[a],
                apart ? fmt::format(", with a spacing of {}", apart->at(a)) : std::string{}));
        }
    }
    return notes;
}

ChosenAxes by_names(const ChosenAxes& chosen, std::span<const ArrayAxis> axes) {
    ChosenAxes named = chosen;
    named.axis = {};
    named.nodes = {1, 1, 1};
    named.no_space = {};
    std::size_t count = 0;
    for (const std::optional<std::size_t>& axis : chosen.axis) {
        if (!axis) {
            continue;
        }
        ++count;
        const std::string& name = axes[*axis].name;
        const std::size_t a = name == "x" ? 0 : name == "y" ? 1 : name == "z" ? 2 : 3;
        if (a == 3 || named.axis.at(a)) {
            return chosen;
        }
        named.axis.at(a) = axis;
        named.nodes[static_cast<int>(a)] = axes[*axis].length;
    }
    return count == 3 || (count == 2 && !named.axis[2]) ? named : chosen;
}

}  // namespace isonest::detail
