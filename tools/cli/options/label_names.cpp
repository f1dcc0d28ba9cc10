#include "tools/cli/options/label_names.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <optional>
#include <set>
#include <vector>

#include <isonest/error.h>

#include "tools/cli/terminal/suggestions.h"

namespace isonest::detail::cli {

bool is_label_range(const std::string& text) {
    const auto number = [](const std::string& part) {
        const std::size_t sign = part.starts_with('-') || part.starts_with('+') ? 1 : 0;
        return part.size() > sign &&
               std::all_of(part.begin() + static_cast<std::ptrdiff_t>(sign), part.end(),
                           [](unsigned char c) { return std::isdigit(c) != 0; });
    };
    // A dash in front is a sign.
    const std::size_t dash = text.find('-', 1);
    return text.empty() || (number(text.substr(0, dash)) &&
                            (dash == std::string::npos || number(text.substr(dash + 1))));
}

std::int64_t label_named(const Store& store, const std::string& name) {
    const std::vector<std::int64_t> ids = store.labels_named(name);
    if (ids.size() == 1) {
        return ids.front();
    }
    const std::string path = store.path().string();
    constexpr std::size_t kMostListed = 20;
    if (ids.size() > 1) {
        const std::size_t listed = std::min(ids.size(), kMostListed);
        throw Error(
            ErrorKind::invalid_argument, {path},
            fmt::format(
                "{} labels are called '{}'; give the number of one: {}{}", ids.size(), name,
                fmt::join(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(listed), ", "),
                ids.size() > listed ? ", ..." : ""));
    }
    std::set<std::string> there;
    for (const LabelName& label : store.label_names()) {
        if (!label.name.empty()) {
            there.insert(label.name);
        }
    }
    if (there.empty()) {
        throw Error(ErrorKind::not_found, {path},
                    fmt::format("there is no label '{}': the store has no names of labels, only "
                                "their numbers",
                                name));
    }
    const std::vector<std::string> names(there.begin(), there.end());
    const std::vector<std::string> nearest = nearest_names(name, names, 3);
    const std::vector<std::string>& listed = nearest.empty() ? names : nearest;
    constexpr std::size_t kMostText = 300;
    std::string list = listed.front();
    std::size_t count = 1;
    while (count < listed.size() && list.size() + listed[count].size() < kMostText) {
        list += ", " + listed[count++];
    }
    throw Error(ErrorKind::not_found, {path},
                fmt::format("there is no label '{}'; {} {}{}", name,
                            nearest.empty() ? "there are" : "the nearest names are", list,
                            count < listed.size() ? ", ..." : ""));
}

MeshFileOptions label_file_options(const Store& store, std::int64_t id, MeshSpace space) {
    const LabelName label = store.label_name(id).value_or(LabelName{});
    return {.replace = true, .title = label.name, .color = label.color, .space = space};
}

void add_label_name(const Store& store, std::int64_t id, Json& json) {
    const LabelName label = store.label_name(id).value_or(LabelName{});
    if (!label.name.empty()) {
        json["name"] = label.name;
    }
    if (label.color) {
        json["color"] = *label.color;
    }
}

std::string label_name_text(const Store& store, std::int64_t id) {
    const LabelName label = store.label_name(id).value_or(LabelName{});
    return label.name.empty() ? "" : fmt::format(" ({})", label.name);
}

}  // namespace isonest::detail::cli
