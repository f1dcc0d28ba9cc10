#include "preprocess/sources/tiff/tiff_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"

namespace isonest::detail {
namespace {

constexpr std::string_view kXmlBlanks = " \t\r\n";

/// In UTF-8; empty for an invalid character.
std::string utf8(std::uint32_t code) {
    constexpr std::uint32_t kMax = 0x10FFFF;
    const auto tail = [&](unsigned shift) {
        return static_cast<char>(0x80U | ((code >> shift) & 0x3FU));
    };
    if (code < 0x80) {
        return {static_cast<char>(code)};
    }
    if (code < 0x800) {
        return {static_cast<char>(0xC0U | code >> 6U), tail(0)};
    }
    if (code < 0x10000) {
        return {static_cast<char>(0xE0U | code >> 12U), tail(6), tail(0)};
    }
    return code > kMax
               ? std::string()
               : std::string{static_cast<char>(0xF0U | code >> 18U), tail(12), tail(6), tail(0)};
}

/// The character for "&name;"; empty if unknown.
std::string referenced(std::string_view name) {
    constexpr std::array<std::pair<std::string_view, std::string_view>, 5> kNamed{
        {{"lt", "<"}, {"gt", ">"}, {"amp", "&"}, {"quot", "\""}, {"apos", "'"}}};
    for (const auto& [known, character] : kNamed) {
        if (name == known) {
            return std::string(character);
        }
    }
    if (!name.starts_with('#')) {
        return {};
    }
    const bool is_hex = name.starts_with("#x");
    name.remove_prefix(is_hex ? 2 : 1);
    std::uint32_t code = 0;
    const auto [end, error] =
        std::from_chars(name.data(), name.data() + name.size(), code, is_hex ? 16 : 10);
    return error == std::errc{} && end == name.data() + name.size() ? utf8(code) : std::string();
}

std::string resolved(std::string_view value) {
    constexpr std::size_t kLongestReference = 32;
    std::string out;
    while (!value.empty()) {
        const std::size_t from = std::min(value.find('&'), value.size());
        out += value.substr(0, from);
        value.remove_prefix(from);
        const std::size_t end = value.substr(0, kLongestReference).find(';');
        const std::string character = value.empty() || end == std::string_view::npos
                                          ? std::string()
                                          : referenced(value.substr(1, end - 1));
        if (!character.empty()) {
            out += character;
            value.remove_prefix(end + 1);
        } else if (!value.empty()) {
            out += '&';
            value.remove_prefix(1);
        }
    }
    return out;
}

class Elements {
  public:
    Elements(std::string_view text, const std::string& name) : text_(text), name_(name) {}

    std::vector<XmlElement> all() {
        std::vector<XmlElement> elements;
        int depth = 0;
        for (at_ = text_.find('<'); at_ != std::string_view::npos; at_ = text_.find('<', at_)) {
            if (skip("<!--", "-->") || skip("<![CDATA[", "]]>") || skip("<?", "?>") ||
                skip("<!", ">")) {
                continue;
            }
            if (skip("</", ">")) {
                --depth;
                continue;
            }
            ++at_;
            XmlElement element;
            element.depth = depth;
            const bool is_closed = read(element);
            depth += is_closed ? 0 : 1;
            if (!is_closed) {
                element.text =
                    text_.substr(at_, std::min(text_.find('<', at_), text_.size()) - at_);
            }
            elements.push_back(std::move(element));
        }
        return elements;
    }

  private:
    [[noreturn]] void has_no_end(std::size_t from) const {
        throw Error(ErrorKind::corrupt, {name_, "OME-XML"},
                    fmt::format("the tag at byte {} is not closed", from));
    }
    bool skip(std::string_view begin, std::string_view end) {
        if (!text_.substr(at_).starts_with(begin)) {
            return false;
        }
        const std::size_t found = text_.find(end, at_ + begin.size());
        if (found == std::string_view::npos) {
            has_no_end(at_);
        }
        at_ = found + end.size();
        return true;
    }
    /// Reads up to one of these characters.
    std::string_view until(std::string_view characters) {
        const std::size_t from = at_;
        at_ = text_.find_first_of(characters, at_);
        if (at_ == std::string_view::npos) {
            has_no_end(from);
        }
        return text_.substr(from, at_ - from);
    }
    void skip_blanks() { at_ = std::min(text_.find_first_not_of(kXmlBlanks, at_), text_.size()); }
    /// Reads from after "<" to after ">"; returns whether the element ends there.
    bool read(XmlElement& element) {
        const std::size_t from = at_;
        const std::string_view whole = until(" \t\r\n/>");
        element.name = whole.substr(whole.find(':') + 1);
        for (;;) {
            skip_blanks();
            const std::string_view rest = text_.substr(at_);
            if (rest.empty()) {
                has_no_end(from);
            }
            if (rest.starts_with('>') || rest.starts_with("/>")) {
                const bool is_closed = rest.front() == '/';
                at_ += is_closed ? 2 : 1;
                return is_closed;
            }
            const std::string_view key = until(" \t\r\n=>");
            skip_blanks();
            if (key.empty() || at_ >= text_.size() || text_[at_] != '=') {
                has_no_end(from);
            }
            ++at_;
            skip_blanks();
            if (at_ >= text_.size() || (text_[at_] != '"' && text_[at_] != '\'')) {
                has_no_end(from);
            }
            const std::string_view mark = text_.substr(at_, 1);
            ++at_;
            element.attributes.emplace(key, resolved(until(mark)));
            ++at_;
        }
    }

    std::string_view text_;
    const std::string& name_;
    std::size_t at_ = 0;
};

}  // namespace

std::string XmlElement::attribute(const std::string& key) const {
    const auto found = attributes.find(key);
    return found == attributes.end() ? std::string() : found->second;
}

std::vector<XmlElement> xml_elements(std::string_view text, const std::string& name) {
    return Elements(text, name).all();
}

namespace {

/// One of x, y and z.
std::string size_key(std::size_t axis) {
    return fmt::format("PhysicalSize{}", "XYZ"[axis]);
}

/// By default, sizes are in micrometres. An axis of several positions without a size has no unit.
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

/// An element that assigns planes to directories.
struct PlaneData {
    std::string uuid;
    std::string file_name;
    std::optional<std::size_t> file;  ///< in the set
    std::int64_t directory = 0;
    std::int64_t plane = 0;
    std::optional<std::int64_t> count;  ///< none: all directories of the file
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
                throw Error(
                    ErrorKind::corrupt, {set.name, "OME-XML"},
                    fmt::format("{} is {}, but the axis has length {}", key, first, axis.length));
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

/// The page of each plane; empty if pages are in the order of the planes. `axes`: fastest first.
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
                        fmt::format("some planes are in the file '{:.80}', which is not in the "
                                    "input; give all files of the set",
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
                            fmt::format("a plane is in directory {}, which does not exist",
                                        data.directory + i));
            }
            pages[static_cast<std::size_t>(data.plane + i)] = *page;
        }
    }
    bool as_they_come = true;
    for (std::size_t plane = 0; plane < pages.size(); ++plane) {
        if (pages[plane] < 0) {
            throw Error(ErrorKind::unsupported, {set.name, "OME-XML"},
                        fmt::format("the directory of plane {} is not given", plane));
        }
        as_they_come = as_they_come && pages[plane] == static_cast<std::int64_t>(plane);
    }
    return as_they_come ? std::vector<std::int64_t>() : pages;
}

}  // namespace

std::optional<TiffAxes> axes_of_ome(const std::string& description, const TiffSet& set) {
    constexpr std::size_t kMaxBefore = 16;  // blanks, or a byte order mark
    if (description.find('<') > kMaxBefore || description.find("OME") == std::string::npos ||
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
                    "the file has several images; write the volume to a separate file");
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
    // Channels may be stored as samples of one page instead.
    const auto channels = leading_number<std::int64_t>(pixels.attribute("SizeC"), 1);
    if (channels > 1 && product == set.pages * channels) {
        std::erase_if(planes, [](const ArrayAxis& a) { return a.name == "c"; });
        product = set.pages;
    }
    TiffAxes axes;
    axes.pages.assign(planes.rbegin(), planes.rend());
    if (product != set.pages) {
        throw Error(ErrorKind::unsupported, {set.name, "OME-XML"},
                    fmt::format("it describes {} pages, but the input has {}; if the set has "
                                "several files, give all of them",
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

namespace {

/// The value in a "key=value" line; empty if there is no such key.
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

/// ImageJ gives units for y and z only if they differ from that of x. A length in pixels has no
/// unit.
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
    constexpr std::int64_t kMax = std::int64_t{1} << 50U;
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
                length.get<std::uint64_t>() > static_cast<std::uint64_t>(kMax / all)) {
                return 1;
            }
            all *= length.get<std::int64_t>();
        }
        return all % values == 0 ? all / values : 1;
    } catch (const Error&) {
        return 1;  // another program's description
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
