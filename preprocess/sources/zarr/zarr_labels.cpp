#include "preprocess/sources/zarr/zarr_labels.h"

#include <fmt/format.h>

#include <cstdint>
#include <limits>
#include <optional>
#include <string>

namespace isonest::detail {
namespace {

using nlohmann::json;

/// Null if it is not there, or no list.
const json& entries(const json& image_label, const char* key) {
    static const json none = json::array();
    if (!image_label.is_object()) {
        return none;
    }
    const auto it = image_label.find(key);
    return it != image_label.end() && it->is_array() ? *it : none;
}

/// Its "label-value", if that is a whole number.
std::optional<std::int64_t> label_value(const json& entry) {
    const auto it = entry.is_object() ? entry.find("label-value") : entry.end();
    if (!entry.is_object() || it == entry.end() || !it->is_number_integer()) {
        return std::nullopt;
    }
    constexpr std::uint64_t kMost = std::numeric_limits<std::int64_t>::max();
    if (it->is_number_unsigned() && it->get<std::uint64_t>() > kMost) {
        return std::nullopt;
    }
    return it->get<std::int64_t>();
}

/// Opacity, the fourth number, is not kept.
std::optional<LabelColor> color_of_rgba(const json& rgba) {
    constexpr std::int64_t kMost = 255;
    LabelColor color{};
    if (!rgba.is_array() || rgba.size() < color.size() || rgba.size() > color.size() + 1) {
        return std::nullopt;
    }
    for (std::size_t i = 0; i < color.size(); ++i) {
        const bool whole = rgba[i].is_number_integer();
        const auto part = whole ? rgba[i].get<std::int64_t>() : -1;
        if (part < 0 || part > kMost) {
            return std::nullopt;
        }
        color.at(i) = static_cast<std::uint8_t>(part);
    }
    return color;
}

}  // namespace

FoundLabels labels_of_ome(const json& image_label) {
    FoundLabels labels;
    for (const json& entry : entries(image_label, "properties")) {
        const auto id = label_value(entry);
        if (!id) {
            labels.leave_out("a property whose label-value is no whole number");
            continue;
        }
        for (const char* const key : {"name", "class"}) {
            const auto it = entry.find(key);
            if (it != entry.end() && it->is_string()) {
                labels.add(*id, it->get<std::string>(), std::nullopt);
                break;
            }
        }
    }
    for (const json& entry : entries(image_label, "colors")) {
        const auto id = label_value(entry);
        const auto rgba = entry.is_object() ? entry.find("rgba") : entry.end();
        if (!id) {
            labels.leave_out("a colour whose label-value is no whole number");
        } else if (rgba != entry.end()) {
            if (const auto color = color_of_rgba(*rgba)) {
                labels.add(*id, "", color);
            } else {
                labels.leave_out(
                    fmt::format("label {}: its colour is not whole numbers from 0 to 255", *id));
            }
        }
    }
    return labels;
}

}  // namespace isonest::detail
