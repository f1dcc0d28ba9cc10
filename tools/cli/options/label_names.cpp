#include "tools/cli/options/label_names.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "tools/cli/terminal/terminal_text.h"

namespace isonest::detail::cli {
namespace {

/// An object as indented lines, without its closing brace.
std::string opened(const Json& object, const std::string& indent) {
    std::string text;
    for (const char c : object.dump(2, ' ', false, Json::error_handler_t::replace)) {
        text += c;
        text += c == '\n' ? indent : "";
    }
    text.resize(text.rfind('\n'));
    return text;
}

}  // namespace

void LabelNeighbours::take(std::size_t label, SmoothReport& report) {
    const auto bytes = std::as_bytes(std::span(report.neighbours));
    std::uint64_t at = 0;
    {
        const std::lock_guard lock(mutex_);
        at = end_;
        end_ += bytes.size();
    }
    file_.write_at(at, bytes);
    place_[label] = {at, report.neighbours.size()};
    report.neighbours = {};
}

std::vector<NeighbourLabel> LabelNeighbours::of(std::size_t label) const {
    const auto [at, count] = place_[label];
    std::vector<NeighbourLabel> neighbours(count);
    file_.read_at(at, std::as_writable_bytes(std::span(neighbours)));
    return neighbours;
}

void write_label_list(const std::filesystem::path& path, const Json& head, const Json& labels,
                      const LabelNeighbours* neighbours) {
    AppendedFile file(path);
    const auto add = [&](const std::string& text) { file.add(std::as_bytes(std::span(text))); };
    add(opened(head, "") + ",\n  \"labels\": [");
    for (std::size_t i = 0; i < labels.size(); ++i) {
        add((i > 0 ? ",\n    " : "\n    ") + opened(labels[i], "    "));
        if (neighbours != nullptr) {
            add(",\n      \"neighbours\": [");
            const char* before = "";
            for (const NeighbourLabel& neighbour : neighbours->of(i)) {
                add(fmt::format("{}{{\"id\": {}, \"area\": {}}}", before, neighbour.id,
                                Json(neighbour.area).dump()));
                before = ", ";
            }
            add("]");
        }
        add("\n    }");
    }
    add(labels.empty() ? "]\n}\n" : "\n  ]\n}\n");
    file.publish();
}

bool is_label_range(const std::string& text) {
    const auto number = [](const std::string& part) {
        const std::size_t sign = part.starts_with('-') || part.starts_with('+') ? 1 : 0;
        return part.size() > sign &&
               std::all_of(part.begin() + static_cast<std::ptrdiff_t>(sign), part.end(),
                           [](unsigned char c) { return std::isdigit(c) != 0; });
    };
    // A leading dash is a sign.
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
    constexpr std::size_t kMaxListed = 20;
    if (ids.size() > 1) {
        const std::size_t listed = std::min(ids.size(), kMaxListed);
        throw Error(
            ErrorKind::invalid_argument, {path},
            fmt::format(
                "{} labels have the name '{}'; give a number instead: {}{}", ids.size(), name,
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
        throw Error(
            ErrorKind::not_found, {path},
            fmt::format(
                "there is no label '{}': the labels of this store have numbers, but no names",
                name));
    }
    const std::vector<std::string> names(there.begin(), there.end());
    const std::vector<std::string> nearest = nearest_names(name, names, 3);
    const std::vector<std::string>& listed = nearest.empty() ? names : nearest;
    constexpr std::size_t kMaxText = 300;
    std::string list = listed.front();
    std::size_t count = 1;
    while (count < listed.size() && list.size() + listed[count].size() < kMaxText) {
        list += ", " + listed[count++];
    }
    throw Error(ErrorKind::not_found, {path},
                fmt::format("there is no label '{}'; {} {}{}", name,
                            nearest.empty() ? "there are" : "the nearest names are", list,
                            count < listed.size() ? ", ..." : ""));
}

MeshFileOptions label_file_options(const Store& store, std::int64_t id, MeshFileOptions options) {
    const LabelName label = store.label_name(id).value_or(LabelName{});
    options.title = label.name;
    options.color = label.color;
    return options;
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
