#include "preprocess/sources/tiff/tiff_axes.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/json_file.h"
#include "preprocess/sources/tiff/leading_number.h"
#include "preprocess/sources/tiff/ome_axes.h"

namespace isonest::detail {
namespace {

/// Of "key=value" lines; empty if there is no such key.
std::string_view line_value(std::string_view text, std::string_view key) {
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = std::min(text.find('\n', at), text.size());
        const std::string_view line = text.substr(at, end - at);
        if (line.starts_with(key) && line.size() > key.size() && line[key.size()] == '=') {
            return line.substr(key.size() + 1);
        }
        at = end + 1;
    }
    return {};
}

/// ImageJ has a unit of y and z where it is not that of x. What is counted in pixels has none.
CommonUnit imagej_unit(std::string_view text) {
    AxisUnits units;
    constexpr std::array<const char*, 3> kKeys{"unit", "yunit", "zunit"};
    for (std::size_t a = 0; a < 3; ++a) {
        const std::string own(line_value(text, kKeys.at(a)));
        units.at(a) = !own.empty() ? own : a > 0 ? units.at(0) : "";
        if (units.at(a)->starts_with("pixel")) {
            units.at(a) = "";
        }
    }
    return common_unit(units);
}

TiffAxes of_imagej(const std::string& text, std::int64_t pages) {
    const auto count = [&](const char* key) {
        return std::max<std::int64_t>(leading_number<std::int64_t>(line_value(text, key), 1), 1);
    };
    TiffAxes axes;
    const std::int64_t channels = count("channels");
    const std::int64_t frames = count("frames");
    const std::int64_t both = channels <= pages && frames <= pages ? channels * frames : 1;
    if (both > 1 && pages % both == 0) {
        axes.pages = {{"t", frames, false}, {"z", pages / both}, {"c", channels, false}};
    } else {
        axes.pages = {{"z", pages}};
    }
    const auto spacing = leading_number<double>(line_value(text, "spacing"), 0);
    if (std::isfinite(spacing) && spacing != 0) {
        axes.spacing = Double3{0, 0, std::fabs(spacing)};
    } else if (!line_value(text, "unit").empty()) {
        axes.spacing = Double3{0, 0, 1};
    }
    axes.unit = imagej_unit(text);
    return axes;
}

/// tifffile writes {"shape": [5, 37, 41], "truncated": true}.
std::int64_t truncated_images(const std::string& description, std::int64_t values) {
    constexpr std::int64_t kMost = std::int64_t{1} << 50U;
    if (values < 1 || !description.starts_with('{') ||
        description.find("\"truncated\"") == std::string::npos) {
        return 1;
    }
    try {
        const nlohmann::json said = parse_json(description, "");
        if (!said.is_object() || said.value("truncated", nlohmann::json()) != true) {
            return 1;
        }
        std::int64_t all = 1;
        for (const nlohmann::json& length : said.value("shape", nlohmann::json::array())) {
            if (!length.is_number_unsigned() || length.get<std::uint64_t>() < 1 ||
                length.get<std::uint64_t>() > static_cast<std::uint64_t>(kMost / all)) {
                return 1;
            }
            all *= length.get<std::int64_t>();
        }
        return all % values == 0 ? all / values : 1;
    } catch (const Error&) {
        return 1;  // the words of somebody else
    }
}

}  // namespace

std::int64_t images_of_description(const std::string& description, std::int64_t values) {
    return description.starts_with("ImageJ=")
               ? std::max<std::int64_t>(
                     leading_number<std::int64_t>(line_value(description, "images"), 1), 1)
               : truncated_images(description, values);
}

TiffAxes axes_of_description(const std::string& description, const TiffSet& set) {
    if (description.starts_with("ImageJ=")) {
        return of_imagej(description, set.pages);
    }
    if (auto axes = axes_of_ome(description, set)) {
        return *std::move(axes);
    }
    return {{{"z", set.pages}}, std::nullopt};
}

}  // namespace isonest::detail
