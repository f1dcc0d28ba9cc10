#include "preprocess/sources/tiff/ome_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/tiff/leading_number.h"
#include "preprocess/sources/tiff/ome_xml.h"

namespace isonest::detail {
namespace {

/// One of x, y and z.
std::string size_key(std::size_t axis) {
    return fmt::format("PhysicalSize{}", "XYZ"[axis]);
}

/// Without a word of it, sizes are in micrometres. An axis of several positions without a size has
/// no unit.
/// Source: https://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd
CommonUnit ome_unit(const XmlElement& pixels, const TiffSet& set) {
    const std::array<std::int64_t, 3> lengths{
        set.width, set.height, leading_number<std::int64_t>(pixels.attribute("SizeZ"), 1)};
    AxisUnits units;
    for (std::size_t a = 0; a < 3; ++a) {
        if (!pixels.attribute(size_key(a)).empty()) {
            const std::string unit = pixels.attribute(size_key(a) + "Unit");
            units.at(a) = unit.empty() ? "um" : unit;
        } else if (lengths.at(a) > 1) {
            units.at(a) = "";
        }
    }
    return common_unit(units);
}

/// An element that says which planes some directories have.
struct PlaneData {
    std::string uuid;
    std::string file_name;
    std::optional<std::size_t> file;  ///< of the set
    std::int64_t directory = 0;
    std::int64_t plane = 0;
    std::optional<std::int64_t> count;  ///< none: all of the file
};

/// `axes`: of the planes, fastest first.
std::vector<PlaneData> plane_data(const std::vector<XmlElement>& elements,
                                  const std::vector<ArrayAxis>& axes, const TiffSet& set) {
    std::vector<PlaneData> list;
    const std::string own = elements.front().attribute("UUID");
    for (std::size_t i = 0; i < elements.size(); ++i) {
        const XmlElement& element = elements[i];
        if (element.name != "TiffData") {
            continue;
        }
        PlaneData data;
        std::int64_t stride = 1;
        for (const ArrayAxis& axis : axes) {
            const std::string key = axis.name == "z"   ? "FirstZ"
                                    : axis.name == "c" ? "FirstC"
                                                       : "FirstT";
            const auto first = leading_number<std::int64_t>(element.attribute(key), 0);
            if (first < 0 || first >= axis.length) {
                throw Error(ErrorKind::corrupt, {set.name, "OME-XML"},
                            fmt::format("{} {} of {}", key, first, axis.length));
            }
            data.plane += first * stride;
            stride *= axis.length;
        }
        const std::string directory = element.attribute("IFD");
        data.directory = std::max<std::int64_t>(leading_number<std::int64_t>(directory, 0), 0);
        if (const std::string count = element.attribute("PlaneCount"); !count.empty()) {
            data.count = leading_number<std::int64_t>(count, 1);
        } else if (!directory.empty()) {
            data.count = 1;
        }
        if (i + 1 < elements.size() && elements[i + 1].name == "UUID" &&
            elements[i + 1].depth == element.depth + 1) {
            data.uuid = elements[i + 1].text;
            data.file_name = elements[i + 1].attribute("FileName");
        }
        const auto named = std::find(set.files.begin(), set.files.end(), data.file_name);
        if (!data.file_name.empty() && named != set.files.end()) {
            data.file = static_cast<std::size_t>(named - set.files.begin());
        } else if (data.uuid.empty() || data.uuid == own) {
            data.file = 0;
        }
        list.push_back(std::move(data));
    }
    return list;
}

/// The page of each plane; empty where they are in the planes' order. `axes`: fastest first.
std::vector<std::int64_t> pages_of_planes(const std::vector<XmlElement>& elements,
                                          const std::vector<ArrayAxis>& axes, const TiffSet& set) {
    std::vector<PlaneData> list = plane_data(elements, axes, set);
    if (list.empty() || (list.size() == 1 && list[0].plane == 0 && list[0].directory == 0)) {
        return {};
    }
    if (std::none_of(list.begin(), list.end(), [](const PlaneData& d) { return d.file; })) {
        // Files that were renamed.
        const bool one_file = std::all_of(list.begin(), list.end(), [&](const PlaneData& d) {
            return set.files.size() == 1 && d.uuid == list[0].uuid;
        });
        if (!one_file) {
            return {};
        }
        for (PlaneData& data : list) {
            data.file = 0;
        }
    }
    std::vector<std::int64_t> pages(static_cast<std::size_t>(set.pages), -1);
    for (const PlaneData& data : list) {
        if (!data.file) {
            throw Error(ErrorKind::unsupported, {set.name, "OME-XML"},
                        fmt::format("some planes are in the file '{:.80}', which is not among "
                                    "these: give all files of the set",
                                    data.file_name));
        }
        const std::int64_t count = std::min(data.count.value_or(set.pages), set.pages - data.plane);
        for (std::int64_t i = 0; i < count; ++i) {
            const auto page = set.page_of(*data.file, data.directory + i);
            if (!page && !data.count) {
                break;  // all directories of the file
            }
            if (!page) {
                throw Error(ErrorKind::corrupt, {set.name, "OME-XML"},
                            fmt::format("a plane is in directory {}, which is not there",
                                        data.directory + i));
            }
            pages[static_cast<std::size_t>(data.plane + i)] = *page;
        }
    }
    bool as_they_come = true;
    for (std::size_t plane = 0; plane < pages.size(); ++plane) {
        if (pages[plane] < 0) {
            throw Error(ErrorKind::unsupported, {set.name, "OME-XML"},
                        fmt::format("it does not say in which directory plane {} is", plane));
        }
        as_they_come = as_they_come && pages[plane] == static_cast<std::int64_t>(plane);
    }
    return as_they_come ? std::vector<std::int64_t>() : pages;
}

}  // namespace

std::optional<TiffAxes> axes_of_ome(const std::string& description, const TiffSet& set) {
    constexpr std::size_t kMostBefore = 16;  // blanks, or a mark of the byte order
    if (description.find('<') > kMostBefore || description.find("OME") == std::string::npos ||
        description.find("Pixels") == std::string::npos) {
        return std::nullopt;
    }
    const std::vector<XmlElement> elements = xml_elements(description, set.name);
    const auto is_pixels = [](const XmlElement& e) { return e.name == "Pixels"; };
    const auto found = std::find_if(elements.begin(), elements.end(), is_pixels);
    if (found == elements.end() || elements.front().name != "OME") {
        return std::nullopt;
    }
    if (std::find_if(found + 1, elements.end(), is_pixels) != elements.end()) {
        throw Error(ErrorKind::unsupported, {set.name, "OME-XML"},
                    "several images in one file; write the one that is the volume to a file of "
                    "its own");
    }
    const XmlElement& pixels = *found;
    const std::string order = pixels.attribute("DimensionOrder");
    std::vector<ArrayAxis> planes;  // fastest first
    std::int64_t product = 1;
    for (std::size_t i = 2; i < order.size(); ++i) {  // x and y come first
        const char axis = order[i];
        const auto length =
            leading_number<std::int64_t>(pixels.attribute(fmt::format("Size{}", axis)), 0);
        if (length < 1 || length > set.pages * set.samples / product) {
            product = 0;
            break;
        }
        product *= length;
        planes.push_back({axis == 'Z' ? "z" : axis == 'C' ? "c" : "t", length, axis == 'Z'});
    }
    // Channels may be samples of one page instead.
    const auto channels = leading_number<std::int64_t>(pixels.attribute("SizeC"), 1);
    if (channels > 1 && product == set.pages * channels) {
        std::erase_if(planes, [](const ArrayAxis& a) { return a.name == "c"; });
        product = set.pages;
    }
    TiffAxes axes;
    axes.pages.assign(planes.rbegin(), planes.rend());
    if (product != set.pages) {
        throw Error(ErrorKind::unsupported, {set.name, "OME-XML"},
                    fmt::format("it describes {} pages, but there are {} here: a set of several "
                                "files is read as the list of its files",
                                text_of(axes.pages), set.pages));
    }
    axes.order = pages_of_planes(elements, planes, set);
    Double3 spacing{1, 1, 1};
    bool any = false;
    for (std::size_t a = 0; a < 3; ++a) {
        const auto size = leading_number<double>(pixels.attribute(size_key(a)), 0);
        axes.said.at(a) = size > 0 && std::isfinite(size);
        if (axes.said.at(a)) {
            spacing.at(a) = size;
            any = true;
        }
    }
    if (any) {
        axes.spacing = spacing;
        axes.unit = ome_unit(pixels, set);
    }
    return axes;
}

}  // namespace isonest::detail
