#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/conventions.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/scaled_source.h"
#include "preprocess/sources/zarr/zarr_chunks.h"
#include "preprocess/sources/zarr/zarr_image.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

/// For x, y and z, the number of the coordinate; none where the volume is flat.
using WorldRows = std::array<std::optional<std::size_t>, 3>;

/// Coordinates called x, y and z are the world's; others are in the order of the axes.
WorldRows rows_of(const ZarrImage& image, const ChosenAxes& chosen) {
    WorldRows named;
    bool has_names = chosen.no_space == std::array<bool, 3>{};
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.axis.at(a)) {
            const auto it =
                std::find(image.world.begin(), image.world.end(), std::string(1, "xyz"[a]));
            named.at(a) = static_cast<std::size_t>(it - image.world.begin());
            has_names = has_names && it != image.world.end();
        }
    }
    return has_names ? named : chosen.axis;
}

/// The common unit of the volume's coordinates; axes with one position need none.
CommonUnit unit_of(const ZarrImage& image, const ChosenAxes& chosen) {
    const WorldRows rows = rows_of(image, chosen);
    AxisUnits units;
    for (std::size_t a = 0; a < 3; ++a) {
        const auto axis = chosen.axis.at(a);
        if (axis && (image.axes[*axis].length > 1 || !image.units[*rows.at(a)].empty())) {
            units.at(a) = image.units[*rows.at(a)];
        }
    }
    return common_unit(units);
}

/// Throws Error{unsupported} if a step along an axis of the volume changes a coordinate that is not
/// one of the volume's, such as the time.
void require_in_volume(const ZarrImage& image, const ChosenAxes& chosen, const WorldRows& rows,
                       const std::string& name) {
    for (std::size_t row = 0; row < image.map.axes(); ++row) {
        if (std::find(rows.begin(), rows.end(), row) != rows.end()) {
            continue;
        }
        for (const std::optional<std::size_t>& axis : chosen.axis) {
            if (axis && image.axes[*axis].length > 1 && image.map.at(row, *axis) != 0) {
                throw Error(ErrorKind::unsupported, {name, "coordinateTransformations"},
                            fmt::format("a step along axis {} changes coordinate {}, which is not "
                                        "one of the volume's",
                                        *axis, row),
                            {{RemedyKind::place_in_world, "spacing"}});
            }
        }
    }
}

/// The place of the chosen axes in the world.
Placement place_of(const ZarrImage& image, const ChosenAxes& chosen, const CommonUnit& unit,
                   const std::string& name) {
    const WorldRows rows = rows_of(image, chosen);
    require_in_volume(image, chosen, rows, name);
    std::array<Double3, 3> steps{};
    Double3 first{0, 0, 0};
    for (std::size_t w = 0; w < 3; ++w) {
        if (!rows.at(w)) {
            continue;
        }
        const std::size_t row = *rows.at(w);
        double at_first = image.map.at(row, image.map.axes());
        for (std::size_t axis = 0; axis < image.map.axes(); ++axis) {
            at_first += image.map.at(row, axis) * static_cast<double>(chosen.at[axis]);
        }
        first.at(w) = unit.converted(w, at_first);
        for (std::size_t a = 0; a < 3; ++a) {
            if (const auto axis = chosen.axis.at(a)) {
                steps.at(a).at(w) = unit.converted(w, image.map.at(row, *axis));
            }
        }
    }
    return place_in_world(chosen.nodes, steps, first, name);
}

/// xarray writes floating point fill values of version 3 as base64 of 8 bytes.
std::optional<double> number_of_base64(const std::string& text) {
    constexpr std::string_view kLetters =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    if (text.size() != 12 || text.back() != '=') {
        return std::nullopt;
    }
    // 66 bits; the last two are unused.
    std::array<unsigned char, 8> bytes{};
    for (std::size_t i = 0; i < 11; ++i) {
        const std::size_t six = kLetters.find(text[i]);
        if (six == std::string_view::npos) {
            return std::nullopt;
        }
        for (std::size_t bit = 6 * i; bit < std::min<std::size_t>(6 * i + 6, 64); ++bit) {
            const auto set = static_cast<unsigned>(six >> (6 * i + 5 - bit)) & 1U;
            bytes.at(bit / 8) =
                static_cast<unsigned char>(bytes.at(bit / 8) | set << (7 - bit % 8));
        }
    }
    return std::bit_cast<double>(bytes);
}

/// The numbers of an attribute; empty if there is none.
std::vector<double> numbers_of(const nlohmann::json& attributes, const std::string& key) {
    std::vector<double> list;
    const auto it = attributes.is_object() ? attributes.find(key) : attributes.end();
    if (!attributes.is_object() || it == attributes.end()) {
        return list;
    }
    for (const nlohmann::json& number : it->is_array() ? *it : nlohmann::json::array({*it})) {
        if (number.is_number()) {
            list.push_back(number.get<double>());
        } else if (number.is_string() && key == "_FillValue") {
            if (const auto decoded = number_of_base64(number.get<std::string>())) {
                list.push_back(*decoded);
            }
        }
    }
    return list;
}

/// Reads CF's attributes. For xarray, the fill value of an array of version 2 is its `_FillValue`.
Scaling scaling_of(const ZarrArray& array, const std::string& name) {
    const nlohmann::json& all = array.attributes;
    const bool fill_is_missing =
        array.has_fill && all.is_object() && all.contains("_ARRAY_DIMENSIONS");
    return cf_scaling(
        [&](const std::string& key) {
            std::vector<double> list = numbers_of(all, key);
            if (key == "_FillValue" && list.empty() && fill_is_missing) {
                list.push_back(array.fill_number);
            }
            return list;
        },
        name);
}

/// All numbers of a one-dimensional array, scaled; empty if there is no such array with `length`
/// numbers.
std::vector<double> coordinates_of(const std::shared_ptr<ZarrFiles>& files,
                                   const std::filesystem::path& folder, std::int64_t length,
                                   const SourceOptions& options) {
    if (!is_zarr_array(*files, folder)) {
        return {};
    }
    const std::string name = folder.string();
    std::vector<double> numbers;
    try {
        ZarrImage image;
        image.array = read_zarr_array(*files, folder);
        if (image.array.shape != Lengths{static_cast<std::uint64_t>(length)}) {
            return {};
        }
        const Scaling scaling = scaling_of(image.array, name);
        const std::optional<StoredNumber> stored = image.array.stored;
        const std::vector<ArrayAxis> axes{{"", length}};
        const ChosenAxes chosen = choose_axes(axes, {}, name);
        std::unique_ptr<VolumeSource> source =
            zarr_chunks(files, std::move(image), chosen, {}, {}, options.max_heap,
                        NeededNodes(chosen.nodes), name);
        if (stored) {
            source = converted(std::move(source), *stored);
        }
        source = scaled(std::move(source), scaling);
        const ValueType type = source->describe().type;
        std::vector<std::byte> bytes(static_cast<std::size_t>(length) * size_of(type));
        source->read(0, 1, 0, 1, bytes.data());
        dispatch(type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            for (std::size_t at = 0; at < bytes.size(); at += sizeof(T)) {
                T number{};
                std::memcpy(&number, bytes.data() + at, sizeof(T));
                numbers.push_back(static_cast<double>(number));
            }
        });
    } catch (const Error& error) {
        if (error.kind() != ErrorKind::unsupported) {
            throw;
        }
        return {};  // text, dates
    }
    return numbers;
}

/// CF's `units` of an array.
std::string unit_of_coordinates(ZarrFiles& files, const std::filesystem::path& folder) {
    const nlohmann::json attributes = read_zarr_array(files, folder).attributes;
    const auto it = attributes.is_object() ? attributes.find("units") : attributes.end();
    return attributes.is_object() && it != attributes.end() && it->is_string()
               ? it->get<std::string>()
               : "";
}

/// The coordinates of an axis are in an array of its name beside the volume, as xarray writes it.
CoordinatePlace place_beside(const std::shared_ptr<ZarrFiles>& files, const ChosenAxes& chosen,
                             const SourceOptions& options, ZarrImage& image,
                             const std::string& name) {
    const std::filesystem::path group = image.array.folder.parent_path();
    std::array<std::optional<AxisCoordinates>, 3> said;
    for (std::size_t a = 0; a < 3; ++a) {
        if (!chosen.axis.at(a)) {
            continue;
        }
        const std::size_t axis = *chosen.axis.at(a);
        said.at(a).emplace();
        const std::string of = image.array.names.empty() ? "" : image.array.names[axis];
        if (of.empty() || of == "." || of == ".." || of.find('/') != std::string::npos) {
            continue;
        }
        std::vector<double> numbers =
            coordinates_of(files, group / of, image.axes[axis].length, options);
        if (numbers.size() >= 2) {
            image.files.push_back(description_of(*files, group / of));
            said.at(a) = {of, std::move(numbers), unit_of_coordinates(*files, group / of)};
        }
    }
    CoordinatePlace by = place_by_coordinates(said, chosen.nodes, options, name);
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.axis.at(a)) {
            const std::size_t axis = *chosen.axis.at(a);
            image.map.at(axis, axis) = by.step.at(a);
            image.map.at(axis, image.map.axes()) = by.first.at(a);
        }
    }
    return by;
}

/// The position of the volume in time. Its coordinate is read from an array in the same folder that
/// has the name of the axis.
std::optional<VolumeTime> time_of(const std::shared_ptr<ZarrFiles>& files, const ChosenAxes& chosen,
                                  const SourceOptions& options, ZarrImage& image) {
    const std::optional<std::size_t> axis = time_axis(image.axes, chosen);
    if (!axis) {
        return std::nullopt;
    }
    VolumeTime time{{}, {}, image.axes[*axis].length};
    const std::string& of = image.axes[*axis].name;
    if (image.ome || of.find('/') != std::string::npos) {
        return time;
    }
    const std::filesystem::path array = image.array.folder.parent_path() / of;
    try {
        const std::vector<double> numbers = coordinates_of(files, array, time.steps, options);
        if (const auto at = static_cast<std::size_t>(chosen.at[*axis]); at < numbers.size()) {
            time.unit = unit_of_coordinates(*files, array);
            time.value = numbers[at];
            image.files.push_back(description_of(*files, array));
        }
    } catch (const Error& error) {
        // The volume can be read without its time.
        if (error.kind() == ErrorKind::cancelled) {
            throw;
        }
    }
    return time;
}

/// The URL may refer to neither an object nor a folder.
ZarrImage find_image(ZarrFiles& files, const VolumeInput& input, const std::string& dataset) {
    try {
        return find_zarr_image(files, files.root(), dataset);
    } catch (const Error& error) {
        if (input.missing != nullptr && error.kind() == ErrorKind::not_found && dataset.empty()) {
            throw Error(*input.missing);
        }
        throw;
    }
}

std::shared_ptr<ZarrFiles> files_of(const VolumeInput& input, const SourceOptions& options) {
    if (input.remote) {
        return remote_zarr_files(input.path(), options.remote);
    }
    if (input.folder) {
        return local_zarr_files(input.path());
    }
    const std::optional<std::string> inside = zarr_in_zip(input.path());
    if (!inside) {
        throw Error(
            ErrorKind::not_found, {input.name()},
            "the archive does not have exactly one Zarr array or group at its top; unpack it");
    }
    return zip_zarr_files(input.path(), *inside);
}

std::unique_ptr<VolumeSource> open_zarr(const VolumeInput& input, const SourceOptions& options) {
    const std::shared_ptr<ZarrFiles> files = files_of(input, options);
    ZarrImage image = find_image(*files, input, options.dataset);
    const std::string name = image.array.folder.string();
    for (const ArrayAxis& axis : image.axes) {
        if (axis.of_volume && axis.length > kMaxNodesPerAxis) {
            throw Error(ErrorKind::unsupported, {name},
                        fmt::format("[{}] nodes: each axis must have 1 to {}", text_of(image.axes),
                                    kMaxNodesPerAxis));
        }
    }
    const ChosenAxes in_order = choose_axes(image.axes, options.index, name);
    const ChosenAxes chosen = image.ome ? by_names(in_order, image.axes) : in_order;
    if (static_cast<double>(chosen.nodes.x) * static_cast<double>(chosen.nodes.y) *
            static_cast<double>(chosen.nodes.z) >
        1e18) {
        throw Error(ErrorKind::corrupt, {name},
                    fmt::format("an array cannot have the shape [{}]", text_of(image.axes)));
    }
    const Scaling scaling = scaling_of(image.array, name);
    std::vector<std::string> notes;
    CommonUnit unit;
    std::array<bool, 3> said{};
    UnevenCoordinates uneven;
    if (image.ome) {
        unit = unit_of(image, chosen);
        notes = image.notes;
        notes.insert(notes.end(), unit.notes.begin(), unit.notes.end());
        said.fill(image.says_scale);
    } else {
        const CoordinatePlace by = place_beside(files, chosen, options, image, name);
        unit.unit = by.unit;
        notes = by.notes;
        said = by.said;
        uneven = by.uneven;
    }
    for (const auto& more : {note_of_spacing(said, chosen.nodes, options), files->notes()}) {
        notes.insert(notes.end(), more.begin(), more.end());
    }
    const std::vector<std::string> about_axes = notes_of(chosen, image.axes);
    notes.insert(notes.end(), about_axes.begin(), about_axes.end());
    const Placement place = place_of(image, chosen, unit, name);
    const std::optional<VolumeTime> time = time_of(files, chosen, options, image);
    const std::optional<StoredNumber> stored = image.array.stored;
    const FoundLabels labels = std::move(image.labels);
    std::unique_ptr<VolumeSource> source =
        with_notes(zarr_chunks(files, std::move(image), chosen, place, unit.unit, options.max_heap,
                               NeededNodes(chosen.nodes, options, place.backward), name),
                   std::move(notes));
    source = with_uneven_axes(mirrored(std::move(source), place.backward), std::move(uneven));
    if (stored) {
        source = converted(std::move(source), *stored);
    }
    source = scaled(std::move(source), scaling);
    if (time) {
        source = with_time(std::move(source), *time);
    }
    return options.labels
               ? with_label_names(with_notes(std::move(source), labels.notes()), labels.names())
               : std::move(source);
}

/// Recognises a ZIP archive by the name of its first member, or by all names.
bool is_zipped_zarr(const VolumeInput& input) {
    constexpr std::size_t kName = 30;
    if (input.remote || !input.head.starts_with("PK\3\4") || input.head.size() < kName) {
        return false;
    }
    const std::size_t length = static_cast<unsigned char>(input.head[26]) +
                               256 * std::size_t{static_cast<unsigned char>(input.head[27])};
    const std::string_view name = std::string_view(input.head).substr(kName, length);
    const std::string_view last = name.substr(name.rfind('/') + 1);
    for (const std::string_view known :
         {".zarray", ".zgroup", ".zattrs", ".zmetadata", "zarr.json"}) {
        if (last == known) {
            return true;
        }
    }
    try {
        return zarr_in_zip(input.path()).has_value();
    } catch (const Error&) {
        return false;  // damaged: unknown contents
    }
}

bool is_zarr(const VolumeInput& input) {
    std::error_code error;
    const std::filesystem::path& folder = input.path();
    if (!input.folder && !input.remote) {
        return is_zipped_zarr(input);
    }
    if (!input.folder || input.remote) {
        return input.folder;  // no other format reads remote folders
    }
    for (const char* const name : {".zarray", ".zgroup", "zarr.json"}) {
        if (std::filesystem::is_regular_file(folder / name, error)) {
            return true;
        }
    }
    return false;
}

}  // namespace

VolumeFormat zarr_format() {
    return {.about = {"Zarr, OME-Zarr", ".zarr .ome.zarr folders, .zarr.zip", ""},
            .takes = {.dataset = true, .index = true},
            .reads_urls = true,
            .recognises = is_zarr,
            .open = open_zarr};
}

}  // namespace isonest::detail
