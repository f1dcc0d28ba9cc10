#include "preprocess/sources/nrrd/nrrd_segments.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string_view>

namespace isonest::detail {
namespace {

template <class T>
bool read_whole(std::string_view text, T& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end == text.data() + text.size() && !text.empty();
}

struct Segment {
    std::string name = {};
    std::string color = {};
    std::string value = "1";
    std::string layer = "0";
};

/// "0.5 0.25 1"
std::optional<LabelColor> color_of_segment(const std::string& text) {
    std::istringstream in(text);
    std::array<double, 3> parts{};
    for (double& part : parts) {
        std::string word;
        in >> word;
        if (!read_whole(word, part)) {
            return std::nullopt;
        }
    }
    std::string more;
    return in >> more ? std::nullopt : color_of_parts(parts[0], parts[1], parts[2]);
}

}  // namespace

FoundLabels labels_of_segments(const std::map<std::string, std::string, std::less<>>& keys,
                               std::optional<std::int64_t> layer) {
    constexpr std::string_view kStart = "Segment";
    std::map<std::uint32_t, Segment> segments;
    for (const auto& [key, text] : keys) {
        const std::string_view rest = std::string_view(key).substr(kStart.size());
        const std::size_t end = rest.find('_');
        std::uint32_t number = 0;
        if (end == std::string_view::npos || !read_whole(rest.substr(0, end), number)) {
            continue;  // "Segmentation_..."
        }
        const std::string_view what = rest.substr(end + 1);
        if (what == "Name") {
            segments[number].name = text;
        } else if (what == "Color") {
            segments[number].color = text;
        } else if (what == "LabelValue") {
            segments[number].value = trimmed(text);
        } else if (what == "Layer") {
            segments[number].layer = trimmed(text);
        }
    }
    FoundLabels labels;
    for (const auto& [number, segment] : segments) {
        std::int64_t id = 0;
        if (!read_whole(segment.value, id)) {
            labels.leave_out(fmt::format("segment {}: its label is no whole number", number));
            continue;
        }
        std::int64_t own = 0;
        if (!layer || !read_whole(segment.layer, own) || own != *layer) {
            labels.leave_out(fmt::format("segment {} is of another layer", number));
            continue;
        }
        std::optional<LabelColor> color;
        if (!segment.color.empty()) {
            color = color_of_segment(segment.color);
            if (!color) {
                labels.leave_out(
                    fmt::format("segment {}: its colour is not three numbers from 0 to 1", number));
            }
        }
        labels.add(id, segment.name, color);
    }
    return labels;
}

}  // namespace isonest::detail
