#include "preprocess/sources/tiff/tiff_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include <isonest/error.h>

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

template <class T>
T number_or(std::string_view text, T otherwise) {
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end != text.data() ? value : otherwise;
}

/// Of an XML tag's text; empty if there is no such attribute.
std::string_view attribute(std::string_view tag, const std::string& key) {
    const std::size_t at = tag.find(" " + key + "=\"");
    if (at == std::string_view::npos) {
        return {};
    }
    const std::size_t from = at + key.size() + 3;
    return tag.substr(from, std::min(tag.find('"', from), tag.size()) - from);
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
        return std::max<std::int64_t>(number_or<std::int64_t>(line_value(text, key), 1), 1);
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
    const auto spacing = number_or<double>(line_value(text, "spacing"), 0);
    if (std::isfinite(spacing) && spacing != 0) {
        axes.spacing = Double3{0, 0, std::fabs(spacing)};
    } else if (!line_value(text, "unit").empty()) {
        axes.spacing = Double3{0, 0, 1};
    }
    axes.unit = imagej_unit(text);
    return axes;
}

/// Without a word of it, sizes are in micrometres.
/// Source: https://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd
CommonUnit ome_unit(std::string_view tag) {
    AxisUnits units;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::string size = fmt::format("PhysicalSize{}", "XYZ"[a]);
        if (!attribute(tag, size).empty()) {
            const std::string_view unit = attribute(tag, size + "Unit");
            units.at(a) = unit.empty() ? "um" : std::string(unit);
        }
    }
    return common_unit(units);
}

TiffAxes of_ome(std::string_view text, std::int64_t pages, const std::string& name) {
    const std::size_t from = text.find("<Pixels ");
    const std::string_view tag = text.substr(from, text.find('>', from) - from);
    if (text.find("<Pixels ", from + 1) != std::string_view::npos) {
        throw Error(ErrorKind::unsupported, {name, "OME-XML"},
                    "several images in one file; write the one that is the volume to a file of "
                    "its own");
    }
    const std::string_view order = attribute(tag, "DimensionOrder");
    TiffAxes axes;
    std::int64_t product = 1;
    for (std::size_t i = order.size(); i-- > 2;) {  // x and y come first
        const char axis = order[i];
        const auto length = number_or<std::int64_t>(attribute(tag, fmt::format("Size{}", axis)), 0);
        if (length < 1 || length > pages) {
            product = 0;
            break;
        }
        product *= length;
        axes.pages.push_back({axis == 'Z' ? "z" : axis == 'C' ? "c" : "t", length, axis == 'Z'});
    }
    // Channels may be samples of one page instead.
    const auto channels = number_or<std::int64_t>(attribute(tag, "SizeC"), 1);
    if (channels > 1 && product == pages * channels) {
        std::erase_if(axes.pages, [](const ArrayAxis& a) { return a.name == "c"; });
        product = pages;
    }
    if (product != pages) {
        throw Error(ErrorKind::unsupported, {name, "OME-XML"},
                    fmt::format("it describes {} pages, but there are {} here: a set of several "
                                "files is read as the list of its files",
                                text_of(axes.pages), pages));
    }
    Double3 spacing{1, 1, 1};
    bool any = false;
    constexpr std::array<const char*, 3> kKeys{"PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"};
    for (std::size_t a = 0; a < 3; ++a) {
        const auto size = number_or<double>(attribute(tag, kKeys.at(a)), 0);
        if (size > 0 && std::isfinite(size)) {
            spacing.at(a) = size;
            any = true;
        }
    }
    if (any) {
        axes.spacing = spacing;
        axes.unit = ome_unit(tag);
    }
    return axes;
}

}  // namespace

std::int64_t imagej_images(const std::string& description) {
    return description.starts_with("ImageJ=")
               ? std::max<std::int64_t>(
                     number_or<std::int64_t>(line_value(description, "images"), 1), 1)
               : 1;
}

TiffAxes axes_of_description(const std::string& description, std::int64_t pages,
                             const std::string& name) {
    if (description.starts_with("ImageJ=")) {
        return of_imagej(description, pages);
    }
    if (description.find("<OME") != std::string::npos &&
        description.find("<Pixels ") != std::string::npos) {
        return of_ome(description, pages, name);
    }
    return {{{"z", pages}}, std::nullopt};
}

}  // namespace isonest::detail
