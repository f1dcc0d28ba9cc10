#include "tools/cli/options/label_list.h"

#include <fmt/format.h>

#include <span>
#include <string>

#include "store/files/appended_file.h"

namespace isonest::detail::cli {
namespace {

/// An object as lines that begin with `indent`, without its closing brace.
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

}  // namespace isonest::detail::cli
