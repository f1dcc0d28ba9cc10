// Imaris, ChimeraX's maps, HyperSpy, Velox, ilastik, and the EMD of Berkeley. Sources:
// https://imaris.oxinst.com/support/imaris-file-format,
// https://www.rbvi.ucsf.edu/chimerax/data/formats.html (cmap),
// https://hyperspy.org/rosettasciio/supported_formats (hspy, emd),
// https://www.ilastik.org/documentation, https://ukoethe.github.io/vigra (axistags).
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "preprocess/sources/hdf5/hdf5_dialects.h"
#include "preprocess/sources/hdf5/hdf5_files.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

constexpr const char* kImaris = "an Imaris file";
constexpr const char* kChimera = "a ChimeraX map";
constexpr const char* kHyperspy = "a HyperSpy signal";
constexpr const char* kVelox = "a Velox image";
constexpr const char* kIlastik = "an ilastik dataset";
constexpr const char* kEmd = "an EMD file";
constexpr std::int64_t kMaxNumbered = 100000;
constexpr std::size_t kMaxImages = 1000;  // groups in ChimeraX files, and arrays in a group
constexpr std::array<const char*, 3> kXyz{"x", "y", "z"};

std::optional<double> number_in(const std::string& text) {
    double number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    return error == std::errc{} && end == text.data() + text.size() && std::isfinite(number)
               ? std::optional(number)
               : std::nullopt;
}

/// The number of members "NAME 0", "NAME 1" and so on.
std::int64_t count_of(const ObjectHandle& group, const std::string& name) {
    const QuietHdf5 quiet;
    std::int64_t count = 0;
    while (is_group(group) && count < kMaxNumbered &&
           H5Lexists(group.get(), fmt::format("{} {}", name, count).c_str(), H5P_DEFAULT) > 0) {
        ++count;
    }
    return count;
}

/// The length of the image along x, y or z, without the padding after it.
std::optional<double> imaris_length(const ObjectHandle& channel, const ObjectHandle& image,
                                    bool finest, std::size_t axis) {
    const char letter = "XYZ"[axis];
    std::string text = joined_text(channel.get(), fmt::format("ImageSize{}", letter).c_str());
    if (text.empty() && finest && is_group(image)) {
        text = joined_text(image.get(), std::string(1, letter).c_str());
    }
    return number_in(text);
}

std::string join(const std::vector<std::string>& path, std::size_t count) {
    std::string text;
    for (std::size_t i = 0; i < count; ++i) {
        text += "/" + path[i];
    }
    return text;
}

double radians(double degrees) {
    return degrees * (3.14159265358979323846 / 180);
}

/// `v` rotated about an axis.
Double3 turned(const Double3& v, Double3 axis, double degrees) {
    const double length = std::hypot(axis[0], axis[1], axis[2]);
    if (!(length > 0)) {
        return v;
    }
    for (double& a : axis) {
        a /= length;
    }
    const double c = std::cos(radians(degrees));
    const double s = std::sin(radians(degrees));
    const double along = axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2];
    const Double3 side{axis[1] * v[2] - axis[2] * v[1], axis[2] * v[0] - axis[0] * v[2],
                       axis[0] * v[1] - axis[1] * v[0]};
    Double3 out{};
    for (std::size_t w = 0; w < 3; ++w) {
        out.at(w) = c * v.at(w) + s * side.at(w) + (1 - c) * along * axis.at(w);
    }
    return out;
}

/// Coordinates `offset`, `offset` + `scale` and so on, if their number is reasonable.
std::vector<double> linear(double offset, double scale, hsize_t count) {
    std::vector<double> numbers;
    if (count <= static_cast<hsize_t>(kMaxNodesPerAxis)) {
        for (hsize_t i = 0; i < count; ++i) {
            numbers.push_back(offset + scale * static_cast<double>(i));
        }
    }
    return numbers;
}

/// Normalises the spellings "<undefined>" and "[n_m]".
std::string plain_unit(std::string text) {
    if (text == "<undefined>") {
        return "";
    }
    std::erase_if(text, [](char c) { return c == '[' || c == ']' || c == '_'; });
    return text;
}

}  // namespace

std::optional<DialectChoice> imaris_choice(hid_t file, const std::string& name,
                                           const std::vector<AxisIndex>& index) {
    const ObjectHandle level = open_inside(file, "DataSet/ResolutionLevel 0");
    if (!is_group(level) &&
        !(is_group(open_inside(file, "DataSet")) && is_group(open_inside(file, "DataSetInfo")))) {
        return std::nullopt;
    }
    const std::int64_t times = count_of(level, "TimePoint");
    const ObjectHandle time =
        level.valid() ? open_inside(level.get(), "TimePoint 0") : ObjectHandle{};
    const std::int64_t channels = count_of(time, "Channel");
    const ObjectHandle first =
        time.valid() ? open_inside(time.get(), "Channel 0/Data") : ObjectHandle{};
    if (times < 1 || channels < 1 || !is_dataset(first)) {
        refuse_dialect(kImaris, name,
                       "there is no DataSet/ResolutionLevel 0/TimePoint 0/Channel 0/Data");
    }
    const DatasetShape shape = shape_of(first.get());
    const ObjectHandle channel = open_inside(time.get(), "Channel 0");
    const ObjectHandle image = open_inside(file, "DataSetInfo/Image");
    std::vector<ArrayAxis> axes{{"t", times, false}, {"c", channels, false}};
    for (std::size_t a = 3; a-- > 0;) {
        const auto length = imaris_length(channel, image, true, a);
        axes.push_back(
            {kXyz.at(a), length && *length >= 1 ? static_cast<std::int64_t>(*length) : 1, true});
    }
    const ChosenAxes chosen = choose_axes(axes, index, name);
    DialectChoice choice;
    choice.dataset = fmt::format("/DataSet/ResolutionLevel 0/TimePoint {}/Channel {}/Data",
                                 chosen.at[0], chosen.at[1]);
    bool is_part = false;
    for (std::size_t i = 2; i < 5; ++i) {
        const bool whole = std::find(chosen.axis.begin(), chosen.axis.end(), std::optional(i)) !=
                           chosen.axis.end();
        choice.index.push_back({"", whole ? std::nullopt : std::optional(chosen.at[i])});
        is_part = is_part || !whole;
    }
    if (!is_part || shape.dims.size() != 3) {
        choice.index.clear();
    }
    return choice;
}

std::optional<Hdf5Dialect> imaris_dialect(const DialectQuestion& asked) {
    const std::vector<std::string>& path = asked.path;
    if (path.size() != 5 || path[0] != "DataSet" || !path[1].starts_with("ResolutionLevel ") ||
        !path[2].starts_with("TimePoint ") || !path[3].starts_with("Channel ") ||
        path[4] != "Data") {
        return std::nullopt;
    }
    if (asked.dims.size() != 3) {
        refuse_dialect(kImaris, asked.of.name, "the values do not have three axes");
    }
    const ObjectHandle channel = open_inside(asked.of.file, join(path, 4));
    const ObjectHandle image = open_inside(asked.of.file, "DataSetInfo/Image");
    Hdf5Dialect dialect;
    dialect.name = kImaris;
    for (std::size_t d = 0; d < 3; ++d) {
        const std::size_t a = 2 - d;
        const auto length = imaris_length(channel, image, path[1] == "ResolutionLevel 0", a);
        if (!length || !(*length >= 1) || *length > static_cast<double>(asked.dims[d]) ||
            *length != std::floor(*length)) {
            refuse_dialect(
                kImaris, asked.of.name,
                fmt::format(
                    "it does not say how many of the {0} values along {1} belong to the image, and "
                    "how many are padding (ImageSize{2} of the channel, {2} of DataSetInfo/Image)",
                    asked.dims[d], kXyz.at(a), "XYZ"[a]));
        }
        dialect.lengths.push_back(static_cast<hsize_t>(*length));
        dialect.axes.push_back({kXyz.at(a), {}, ""});
        Double3 step{0, 0, 0};
        step.at(a) = 1;
        bool said = false;
        if (is_group(image)) {
            const auto low =
                number_in(joined_text(image.get(), fmt::format("ExtMin{}", a).c_str()));
            const auto high =
                number_in(joined_text(image.get(), fmt::format("ExtMax{}", a).c_str()));
            // The extent is that of the voxels, whose centres are the nodes.
            if (low && high && *low != *high) {
                step.at(a) = (*high - *low) / *length;
                dialect.first.at(a) = *low + step.at(a) / 2;
                said = true;
            }
        }
        dialect.steps.push_back(step);
        dialect.said.push_back(said);
    }
    if (is_group(image)) {
        dialect.unit = length_unit_from(joined_text(image.get(), "Unit"));
    }
    return dialect;
}

std::optional<DialectChoice> chimera_choice(hid_t file, const std::string& name,
                                            const std::vector<AxisIndex>& index) {
    const ObjectHandle chimera = open_inside(file, "Chimera");
    if (!is_group(chimera)) {
        return std::nullopt;
    }
    std::vector<std::string> found;
    for (const std::string& group : names_inside(chimera.get(), kMaxImages)) {
        const ObjectHandle image = open_inside(chimera.get(), group);
        if (!is_group(image)) {
            continue;
        }
        for (const std::string& array : names_inside(image.get(), kMaxImages)) {
            const ObjectHandle data = open_inside(image.get(), array);
            if (is_dataset(data) && shape_of(data.get()).dims.size() == 3 &&
                numbers_of_attribute(data.get(), "subsample_spacing").empty()) {
                found.push_back("/Chimera/" + group + "/" + array);
                break;  // the others have the same values in other chunks
            }
        }
    }
    if (found.empty()) {
        refuse_dialect(kChimera, name, "no group of /Chimera has an array of three axes");
    }
    return found.size() == 1 ? std::optional(DialectChoice{found.front(), index}) : std::nullopt;
}

std::optional<Hdf5Dialect> chimera_dialect(const DialectQuestion& asked) {
    if (asked.path.size() != 3 || asked.path[0] != "Chimera" || asked.dims.size() != 3) {
        return std::nullopt;
    }
    if (!numbers_of_attribute(asked.of.dataset, "subsample_spacing").empty()) {
        throw Error(ErrorKind::unsupported, {asked.of.name},
                    "this is a reduced copy of a ChimeraX map; the full map is another array of "
                    "the same group",
                    {{RemedyKind::choose_dataset}});
    }
    const ObjectHandle group = open_inside(asked.of.file, join(asked.path, 2));
    Hdf5Dialect dialect;
    dialect.name = kChimera;
    dialect.unit = LengthUnit::angstrom;
    const auto step = three_of_attribute(group.get(), "step");
    dialect.first = three_of_attribute(group.get(), "origin").value_or(Double3{0, 0, 0});
    const Double3 angles =
        three_of_attribute(group.get(), "cell_angles").value_or(Double3{90, 90, 90});
    std::array<Double3, 3> along{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    if (angles != Double3{90, 90, 90}) {
        const double ca = std::cos(radians(angles[0]));
        const double cb = std::cos(radians(angles[1]));
        const double cg = std::cos(radians(angles[2]));
        const double sg = std::sin(radians(angles[2]));
        const double c1 = (ca - cb * cg) / sg;
        along = {{{1, 0, 0}, {cg, sg, 0}, {cb, c1, std::sqrt(1 - cb * cb - c1 * c1)}}};
    }
    const auto axis = three_of_attribute(group.get(), "rotation_axis");
    const std::vector<double> angle = numbers_of_attribute(group.get(), "rotation_angle");
    for (std::size_t d = 0; d < 3; ++d) {
        const std::size_t a = 2 - d;
        Double3 direction = along.at(a);
        if (axis && angle.size() == 1) {
            direction = turned(direction, *axis, angle[0]);
        }
        for (double& number : direction) {
            number *= step ? step->at(a) : 1;
        }
        dialect.axes.push_back({kXyz.at(a), {}, ""});
        dialect.steps.push_back(direction);
        dialect.said.push_back(step.has_value());
    }
    return dialect;
}

std::optional<DialectChoice> hyperspy_choice(hid_t file, const std::string& name,
                                             const std::vector<AxisIndex>& index) {
    const ObjectHandle experiments = open_inside(file, "Experiments");
    if (!is_group(experiments)) {
        return std::nullopt;
    }
    const std::vector<std::string> names = names_inside(experiments.get(), 2);
    if (names.size() != 1) {
        return std::nullopt;
    }
    const std::string path = "/Experiments/" + names[0] + "/data";
    if (!is_dataset(open_inside(file, path))) {
        refuse_dialect(kHyperspy, name, "there is no " + path);
    }
    return DialectChoice{path, index};
}

std::optional<Hdf5Dialect> hyperspy_dialect(const DialectQuestion& asked) {
    if (asked.path.size() != 3 || asked.path[0] != "Experiments" || asked.path[2] != "data") {
        return std::nullopt;
    }
    Hdf5Dialect dialect;
    dialect.name = kHyperspy;
    dialect.by_names = true;
    const std::string group = join(asked.path, 2);
    for (std::size_t d = 0; d < asked.dims.size(); ++d) {
        const std::string path = fmt::format("{}/axis-{}", group, d);
        const ObjectHandle axis = open_inside(asked.of.file, path);
        if (!is_group(axis)) {
            refuse_dialect(kHyperspy, asked.of.name, "there is no " + path);
        }
        const std::string said = text_of_attribute(axis.get(), "name");
        Hdf5Axis made{said == "<undefined>" ? "" : said,
                      {},
                      plain_unit(text_of_attribute(axis.get(), "units"))};
        made.coordinates = numbers_inside(axis.get(), "axis", kMaxNodesPerAxis);
        if (made.coordinates.empty()) {
            made.coordinates = numbers_of_attribute(axis.get(), "axis");
        }
        const std::vector<double> scale = numbers_of_attribute(axis.get(), "scale");
        const std::vector<double> offset = numbers_of_attribute(axis.get(), "offset");
        if (made.coordinates.empty() && scale.size() == 1 && offset.size() == 1) {
            made.coordinates = linear(offset[0], scale[0], asked.dims[d]);
        }
        if (!made.coordinates.empty() && made.coordinates.size() != asked.dims[d]) {
            refuse_dialect(kHyperspy, asked.of.name,
                           fmt::format("{} has {} coordinates for {} values", path,
                                       made.coordinates.size(), asked.dims[d]));
        }
        dialect.axes.push_back(std::move(made));
    }
    return dialect;
}

std::optional<DialectChoice> velox_choice(hid_t file, const std::string& /*name*/,
                                          const std::vector<AxisIndex>& index) {
    const ObjectHandle images = open_inside(file, "Data/Image");
    if (!is_group(images)) {
        return std::nullopt;
    }
    const std::vector<std::string> names = names_inside(images.get(), 2);
    if (names.size() != 1 || !is_dataset(open_inside(images.get(), names[0] + "/Metadata")) ||
        !is_dataset(open_inside(images.get(), names[0] + "/Data"))) {
        return std::nullopt;
    }
    return DialectChoice{"/Data/Image/" + names[0] + "/Data", index};
}

/// The text of the first frame's metadata: one column of bytes per frame.
std::string velox_metadata(const ObjectHandle& metadata) {
    constexpr hsize_t kMaxBytes = hsize_t{1} << 22U;
    const QuietHdf5 quiet;
    const DatasetShape shape = shape_of(metadata.get());
    if (shape.dims.size() != 2 || shape.dims[0] > kMaxBytes || shape.dims[1] < 1) {
        return "";
    }
    std::string text(shape.dims[0], '\0');
    const SpaceHandle from(H5Dget_space(metadata.get()));
    const std::array<hsize_t, 2> start{0, 0};
    const std::array<hsize_t, 2> count{shape.dims[0], 1};
    H5Sselect_hyperslab(from.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
    const SpaceHandle to(H5Screate_simple(1, shape.dims.data(), nullptr));
    if (H5Dread(metadata.get(), H5T_NATIVE_UCHAR, to.get(), from.get(), H5P_DEFAULT, text.data()) <
        0) {
        return "";
    }
    text.resize(std::min(text.find('\0'), text.size()));
    return text;
}

std::optional<Hdf5Dialect> velox_dialect(const DialectQuestion& asked) {
    if (asked.path.size() != 4 || asked.path[0] != "Data" || asked.path[1] != "Image" ||
        asked.path[3] != "Data" || asked.dims.size() != 3) {
        return std::nullopt;
    }
    const ObjectHandle metadata = open_inside(asked.of.file, join(asked.path, 3) + "/Metadata");
    const std::string text =
        is_dataset(metadata) && holds_its_values(metadata.get()) ? velox_metadata(metadata) : "";
    if (text.empty()) {
        return std::nullopt;
    }
    const nlohmann::json all = parse_json(text, asked.of.name + ": Metadata");
    const nlohmann::json none = nlohmann::json::object();
    const auto inner = [&](const nlohmann::json& of, const char* key) -> const nlohmann::json& {
        const auto it = of.is_object() ? of.find(key) : of.end();
        return of.is_object() && it != of.end() ? *it : none;
    };
    // Numbers are stored as text.
    const auto text_at = [&](const nlohmann::json& value) {
        return value.is_string() ? value.get<std::string>() : value.is_number() ? value.dump() : "";
    };
    const nlohmann::json& result = inner(all, "BinaryResult");
    Hdf5Dialect dialect;
    dialect.name = kVelox;
    constexpr std::array<const char*, 2> kSizes{"height", "width"};
    constexpr std::array<const char*, 2> kPlaces{"y", "x"};
    constexpr std::array<const char*, 2> kUnits{"PixelUnitY", "PixelUnitX"};
    for (std::size_t d = 0; d < 2; ++d) {
        Hdf5Axis axis{kPlaces.at(d), {}, text_at(inner(result, kUnits.at(d)))};
        const auto size = number_in(text_at(inner(inner(result, "PixelSize"), kSizes.at(d))));
        const auto from = number_in(text_at(inner(inner(result, "Offset"), kPlaces.at(d))));
        if (size && *size > 0) {
            axis.coordinates = linear(from.value_or(0), *size, asked.dims[d]);
        }
        dialect.axes.push_back(std::move(axis));
        dialect.of_volume.push_back(true);
    }
    dialect.axes.push_back({"frame", {}, ""});
    dialect.of_volume.push_back(false);
    return dialect;
}

std::optional<Hdf5Dialect> ilastik_dialect(const DialectQuestion& asked) {
    const std::string tags = text_of_attribute(asked.of.dataset, "axistags");
    if (tags.empty()) {
        return std::nullopt;
    }
    const nlohmann::json all = parse_json(tags, asked.of.name + ": axistags");
    const auto list = all.is_object() ? all.find("axes") : all.end();
    if (!all.is_object() || list == all.end() || !list->is_array() ||
        list->size() != asked.dims.size()) {
        refuse_dialect(kIlastik, asked.of.name, "the axistags do not name the axes");
    }
    Hdf5Dialect dialect;
    dialect.name = kIlastik;
    dialect.by_names = true;
    for (std::size_t d = 0; d < asked.dims.size(); ++d) {
        const nlohmann::json& tag = (*list)[d];
        const auto key = tag.is_object() ? tag.find("key") : tag.end();
        if (!tag.is_object() || key == tag.end() || !key->is_string()) {
            refuse_dialect(kIlastik, asked.of.name, "the axistags do not name the axes");
        }
        const auto name = key->get<std::string>();
        const bool of_space = name == "x" || name == "y" || name == "z";
        Hdf5Axis axis{name, {}, ""};
        const auto resolution = tag.find("resolution");
        if (of_space && resolution != tag.end() && resolution->is_number() &&
            resolution->get<double>() > 0) {
            axis.coordinates = linear(0, resolution->get<double>(), asked.dims[d]);
        }
        dialect.axes.push_back(std::move(axis));
        dialect.of_volume.push_back(of_space);
    }
    return dialect;
}

std::optional<Hdf5Dialect> emd_dialect(const DialectQuestion& asked) {
    if (asked.path.empty() || asked.path.back() != "data") {
        return std::nullopt;
    }
    const std::string parent = join(asked.path, asked.path.size() - 1);
    const ObjectHandle group = open_inside(asked.of.file, parent);
    if (!is_group(group) ||
        numbers_of_attribute(group.get(), "emd_group_type") != std::vector<double>{1}) {
        return std::nullopt;
    }
    Hdf5Dialect dialect;
    dialect.name = kEmd;
    dialect.by_names = true;
    for (std::size_t d = 0; d < asked.dims.size(); ++d) {
        const std::string name = fmt::format("dim{}", d + 1);
        const ObjectHandle dim = open_inside(group.get(), name);
        if (!is_dataset(dim)) {
            refuse_dialect(kEmd, asked.of.name, fmt::format("there is no {}/{}", parent, name));
        }
        std::vector<double> numbers = numbers_inside(group.get(), name, kMaxNodesPerAxis);
        if (numbers.size() == 2 && asked.dims[d] != 2) {
            numbers = linear(numbers[0], numbers[1] - numbers[0], asked.dims[d]);
        }
        if (!numbers.empty() && numbers.size() != asked.dims[d]) {
            refuse_dialect(kEmd, asked.of.name,
                           fmt::format("{}/{} has {} coordinates for {} values", parent, name,
                                       numbers.size(), asked.dims[d]));
        }
        dialect.axes.push_back({text_of_attribute(dim.get(), "name"), std::move(numbers),
                                plain_unit(text_of_attribute(dim.get(), "units"))});
    }
    return dialect;
}

}  // namespace isonest::detail
