#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/arrays/netcdf3_header.h"
#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/placement/cf_positions.h"
#include "preprocess/sources/placement/conventions.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/scaled_source.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

constexpr int kText = 2;

bool is_netcdf3(const VolumeInput& input) {
    return input.head.size() > 4 && input.head.starts_with("CDF") &&
           (input.head[3] == 1 || input.head[3] == 2 || input.head[3] == 5);
}

const NetcdfAttribute* attribute_of(const NetcdfVariable& v, const std::string& name) {
    const auto it = std::find_if(v.attributes.begin(), v.attributes.end(),
                                 [&](const NetcdfAttribute& a) { return a.name == name; });
    return it == v.attributes.end() ? nullptr : &*it;
}

std::string text_in(const NetcdfVariable& v, const char* name) {
    const NetcdfAttribute* const said = attribute_of(v, name);
    return said == nullptr ? "" : std::string(said->text.c_str());
}

std::vector<double> numbers_in(const NetcdfVariable& v, const char* name) {
    const NetcdfAttribute* const said = attribute_of(v, name);
    return said == nullptr ? std::vector<double>{} : said->numbers;
}

/// MINC 1: marked by the variables of its standard.
bool is_of_minc(const NetcdfVariable& v) {
    return text_in(v, "varid").starts_with("MINC");
}

bool is_unsigned(const NetcdfVariable& v) {
    constexpr int kByte = 1;
    if (is_of_minc(v) && v.name == "image") {
        const std::string sign = text_in(v, "signtype");
        return sign.empty() ? v.type == kByte : sign.starts_with("unsigned");
    }
    return lower(text_in(v, "_Unsigned")) == "true";
}

void set_type(const NetcdfVariable& v, PlacedArray& array) {
    const bool is_signed = !is_unsigned(v);
    ValueType& type = array.layout.type;
    switch (v.type) {
        case 1:
            type = is_signed ? ValueType::i8 : ValueType::u8;
            return;
        case 3:
            type = is_signed ? ValueType::i16 : ValueType::u16;
            return;
        case 4:
            type = is_signed ? ValueType::i32 : ValueType::u32;
            return;
        case 5:
            type = ValueType::f32;
            return;
        case 6:
            type = ValueType::f64;
            return;
        case 7:
            type = ValueType::u8;
            return;
        case 8:
            type = ValueType::u16;
            return;
        case 9:
            type = ValueType::u32;
            return;
        case 10:
        case 11:
            array.stored = v.type == 10 && is_signed ? StoredNumber::i64 : StoredNumber::u64;
            return;
        default:
            throw Error(ErrorKind::unsupported, {array.name},
                        "the variable holds text; choose one that holds numbers");
    }
}

/// The number of axes longer than 1.
std::size_t long_axes(const NetcdfHeader& header, const NetcdfVariable& v) {
    return static_cast<std::size_t>(std::count_if(
        v.dims.begin(), v.dims.end(), [&](std::size_t d) { return header.dims[d].length > 1; }));
}

/// The coordinates of a dimension are a variable with its name, and it as the only axis.
const NetcdfVariable* coordinates_of(const NetcdfHeader& header, std::size_t dim) {
    for (const NetcdfVariable& v : header.variables) {
        if (v.name == header.dims[dim].name && v.dims == std::vector{dim}) {
            return &v;
        }
    }
    return nullptr;
}

const NetcdfVariable* variable_of(const NetcdfHeader& header, const std::string& name) {
    const auto it = std::find_if(header.variables.begin(), header.variables.end(),
                                 [&](const NetcdfVariable& v) { return v.name == name; });
    return it == header.variables.end() ? nullptr : &*it;
}

std::string list_of(const NetcdfHeader& header) {
    constexpr std::size_t kMaxListed = 40;
    static constexpr std::array<const char*, 12> kTypes{"",       "int8",    "text",    "int16",
                                                        "int32",  "float32", "float64", "uint8",
                                                        "uint16", "uint32",  "int64",   "uint64"};
    std::string list;
    for (std::size_t i = 0; i < std::min(kMaxListed, header.variables.size()); ++i) {
        const NetcdfVariable& v = header.variables[i];
        std::vector<std::uint64_t> lengths;
        lengths.reserve(v.dims.size());
        for (const std::size_t d : v.dims) {
            lengths.push_back(header.dims[d].length);
        }
        list += fmt::format("\n  {:.80} [{}] {}", v.name, fmt::join(lengths, ", "),
                            kTypes.at(static_cast<std::size_t>(v.type)));
    }
    return list.empty() ? " none" : list;
}

const NetcdfVariable& choose(const NetcdfHeader& header, const SourceOptions& options,
                             const std::string& name) {
    const NetcdfVariable* best = nullptr;
    std::size_t count = 0;
    if (options.dataset.empty() &&
        std::any_of(header.variables.begin(), header.variables.end(), is_of_minc)) {
        if (const NetcdfVariable* const image = variable_of(header, "image")) {
            return *image;
        }
        throw Error(
            ErrorKind::corrupt, {name},
            "this is MINC 1, but there is no variable 'image'; the file has:" + list_of(header));
    }
    for (const NetcdfVariable& v : header.variables) {
        const bool scale = v.dims.size() == 1 && v.name == header.dims[v.dims[0]].name;
        if (!options.dataset.empty()) {
            if (v.name == options.dataset) {
                return v;
            }
        } else if (!scale && v.type != kText && !v.dims.empty()) {
            const std::size_t axes = long_axes(header, v);
            const std::size_t most = best == nullptr ? 0 : long_axes(header, *best);
            if (best == nullptr || axes > most) {
                best = &v;
                count = 1;
            } else if (axes == most) {
                ++count;
            }
        }
    }
    if (best == nullptr) {
        throw Error(ErrorKind::not_found, {name},
                    fmt::format("there is no variable '{}' that is a volume; the file has:{}",
                                options.dataset, list_of(header)));
    }
    if (count > 1) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("there are several volumes; the file has:{}", list_of(header)),
                    {{RemedyKind::choose_dataset}});
    }
    return *best;
}

/// Bytes from one position to the next along each axis of a variable.
std::vector<std::uint64_t> strides_of(const NetcdfHeader& header, const NetcdfVariable& v) {
    std::vector<std::uint64_t> strides(v.dims.size());
    std::uint64_t stride = netcdf_type_bytes(v.type);
    for (std::size_t i = v.dims.size(); i-- > 0;) {
        strides[i] = i == 0 && v.record ? header.record_bytes : stride;
        stride *= header.dims[v.dims[i]].length;
    }
    return strides;
}

std::vector<double> read_numbers(const std::filesystem::path& path, const NetcdfHeader& header,
                                 const NetcdfVariable& v) {
    const std::uint64_t count = header.dims[v.dims[0]].length;
    const std::uint64_t stride = strides_of(header, v)[0];
    const std::size_t value = netcdf_type_bytes(v.type);
    if (v.type == kText || count > static_cast<std::uint64_t>(kMaxNodesPerAxis)) {
        return {};
    }
    std::vector<double> numbers;
    constexpr std::uint64_t kPart = std::uint64_t{1} << 16U;
    const std::uint64_t together = std::max<std::uint64_t>(kPart / stride, 1);
    for (std::uint64_t i = 0; i < count; i += together) {
        const std::uint64_t n = std::min(together, count - i);
        const std::size_t size = static_cast<std::size_t>((n - 1) * stride) + value;
        const std::string bytes = first_bytes(path, size, v.begin + i * stride);
        if (bytes.size() != size) {
            return {};
        }
        for (std::uint64_t j = 0; j < n; ++j) {
            numbers.push_back(netcdf_number(bytes, static_cast<std::size_t>(j * stride), v.type));
        }
    }
    if (is_unsigned(v)) {
        take_as_unsigned(numbers, value);
    }
    unpack(numbers, [&](const std::string& name) {
        const NetcdfAttribute* const attribute = attribute_of(v, name);
        return attribute == nullptr ? std::vector<double>{} : attribute->numbers;
    });
    return numbers;
}

/// All numbers of a variable with any number of axes; empty if there are more than `most`, if it is
/// text, or if some are missing.
std::vector<double> all_numbers(const std::filesystem::path& path, const NetcdfHeader& header,
                                const NetcdfVariable& v, std::uint64_t most) {
    const std::size_t value = netcdf_type_bytes(v.type);
    const std::uint64_t records = v.record ? header.dims[v.dims[0]].length : 1;
    const std::uint64_t each = v.bytes / value;
    std::vector<double> numbers;
    if (v.type == kText || each > most || records > most / each) {
        return numbers;
    }
    for (std::uint64_t r = 0; r < records; ++r) {
        const std::string bytes =
            first_bytes(path, static_cast<std::size_t>(v.bytes), v.begin + r * header.record_bytes);
        if (bytes.size() != v.bytes) {
            return {};
        }
        for (std::uint64_t i = 0; i < each; ++i) {
            numbers.push_back(netcdf_number(bytes, static_cast<std::size_t>(i * value), v.type));
        }
    }
    return numbers;
}

/// The place of a MINC image, in the order of its axes.
MincPlace place_of_minc(const NetcdfHeader& header, const NetcdfVariable& v,
                        const SourceOptions& options, const std::string& name) {
    std::vector<MincDimension> dims;
    for (const std::size_t d : v.dims) {
        MincDimension dim{header.dims[d].name, static_cast<std::int64_t>(header.dims[d].length)};
        if (const NetcdfVariable* const said = variable_of(header, dim.name)) {
            dim.start = numbers_in(*said, "start");
            dim.step = numbers_in(*said, "step");
            dim.cosines = numbers_in(*said, "direction_cosines");
            dim.spacing = text_in(*said, "spacing");
            dim.units = text_in(*said, "units");
        }
        dims.push_back(std::move(dim));
    }
    return minc_place(dims, options.spacing.has_value(), name);
}

MincRange range_of_minc(const std::filesystem::path& path, const NetcdfHeader& header,
                        const NetcdfVariable& image, const std::string& name) {
    MincRange range;
    range.valid = numbers_in(image, "valid_range");
    if (range.valid.size() != 2) {
        range.valid = numbers_in(image, "valid_min");
        const std::vector<double> most = numbers_in(image, "valid_max");
        range.valid.insert(range.valid.end(), most.begin(), most.end());
    }
    const NetcdfVariable* const most = variable_of(header, "image-max");
    const NetcdfVariable* const least = variable_of(header, "image-min");
    if (most == nullptr && least == nullptr) {
        return range;
    }
    if (most == nullptr || least == nullptr || most->dims != least->dims ||
        most->dims.size() > image.dims.size() ||
        !std::equal(most->dims.begin(), most->dims.end(), image.dims.begin())) {
        throw Error(ErrorKind::corrupt, {name},
                    "this is MINC 1, but image-min and image-max are not both given along the same "
                    "leading axes of the image");
    }
    range.dims = most->dims.size();
    range.most = all_numbers(path, header, *most, kMaxMincRanges);
    range.least = all_numbers(path, header, *least, kMaxMincRanges);
    if (range.most.empty() || range.least.empty()) {
        throw Error(ErrorKind::corrupt, {name},
                    "this is MINC 1, but image-min and image-max cannot be read");
    }
    return range;
}

AxisCoordinates coordinates_along(const std::filesystem::path& path, const NetcdfHeader& header,
                                  std::size_t dim) {
    const NetcdfVariable* const c = coordinates_of(header, dim);
    if (c == nullptr) {
        return {header.dims[dim].name};
    }
    const NetcdfAttribute* const unit = attribute_of(*c, "units");
    return {c->name, read_numbers(path, header, *c), unit == nullptr ? "" : unit->text};
}

/// The position of the volume in time; nullopt if the array has no axis of times.
std::optional<VolumeTime> time_of(const std::filesystem::path& path, const NetcdfHeader& header,
                                  const NetcdfVariable& v, const SourceOptions& options,
                                  const PlacedArray& array) {
    const ChosenAxes chosen = choose_axes(array.axes, options.index, array.name);
    const std::optional<std::size_t> axis = time_axis(array.axes, chosen);
    if (!axis) {
        return std::nullopt;
    }
    VolumeTime time{{}, {}, array.axes[*axis].length};
    const AxisCoordinates said = coordinates_along(path, header, v.dims[*axis]);
    if (const auto at = static_cast<std::size_t>(chosen.at[*axis]); at < said.numbers.size()) {
        time.value = said.numbers[at];
        time.unit = said.unit;
    }
    return time;
}

/// Places the volume by the coordinates of its axes.
void place_as_cf(const std::filesystem::path& path, const NetcdfHeader& header,
                 const NetcdfVariable& v, const SourceOptions& options, PlacedArray& array,
                 UnevenCoordinates& uneven, std::vector<std::string>& notes) {
    const ChosenAxes chosen = choose_axes(array.axes, options.index, array.name);
    std::array<std::optional<AxisCoordinates>, 3> said;
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.axis.at(a)) {
            said.at(a) = coordinates_along(path, header, v.dims[*chosen.axis.at(a)]);
        }
    }
    const CoordinatePlace by = place_by_coordinates(said, chosen.nodes, options, array.name);
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.axis.at(a)) {
            array.steps[*chosen.axis.at(a)].at(a) = by.step.at(a);
        }
    }
    array.first = by.first;
    array.layout.unit = by.unit;
    uneven = by.uneven;
    notes.insert(notes.end(), by.notes.begin(), by.notes.end());
    const auto unsaid = note_of_spacing(by.said, chosen.nodes, options);
    notes.insert(notes.end(), unsaid.begin(), unsaid.end());
}

/// Places and scales the volume as MINC specifies.
void place_as_minc(const std::filesystem::path& path, const NetcdfHeader& header,
                   const NetcdfVariable& v, const SourceOptions& options, PlacedArray& array,
                   std::vector<std::string>& notes) {
    const MincPlace place = place_of_minc(header, v, options, array.name);
    array.axes = place.axes;
    array.steps = place.steps;
    array.first = place.first;
    array.spacing_is_given = options.spacing.has_value();
    array.layout.unit = place.unit;
    array.layout.frame = AnatomicalFrame::ras;
    const ChosenAxes chosen = choose_axes(array.axes, options.index, array.name);
    if (array.stored) {
        throw Error(ErrorKind::unsupported, {array.name},
                    "this is MINC 1 with 64-bit integers, which MINC does not define");
    }
    const MincRange range = range_of_minc(path, header, v, array.name);
    array.scaling = minc_scaling(range, array.axes, chosen, array.layout.type, array.name);
    if (const std::string note = text_of(range, *array.scaling, array.layout.type); !note.empty()) {
        notes.push_back(note);
    }
    std::array<bool, 3> said{};
    for (std::size_t a = 0; a < 3; ++a) {
        said.at(a) = chosen.axis.at(a) && place.said[*chosen.axis.at(a)];
    }
    const auto unsaid = note_of_spacing(said, chosen.nodes, options);
    notes.insert(notes.end(), unsaid.begin(), unsaid.end());
}

/// The variables that give the nodes positions, if x and y have no coordinates along their axes.
std::optional<CfPositions> find_positions(const NetcdfHeader& header, const NetcdfVariable& v,
                                          const ChosenAxes& chosen) {
    const auto& axis = chosen.axis;
    const Int3& nodes = chosen.nodes;
    if (!axis[0] || !axis[1] || !axis[2] || *axis[2] > *axis[1] || *axis[1] > *axis[0] ||
        std::min({nodes.x, nodes.y, nodes.z}) < 2 ||
        coordinates_of(header, v.dims[*axis[0]]) != nullptr ||
        coordinates_of(header, v.dims[*axis[1]]) != nullptr) {
        return std::nullopt;
    }
    std::vector<CfCoordinate> named;
    for (const std::string& word : words_of(text_in(v, "coordinates"))) {
        const NetcdfVariable* const found = variable_of(header, word);
        if (found == nullptr || found->type == kText) {
            continue;
        }
        CfCoordinate& c = named.emplace_back(CfCoordinate{word,
                                                          {},
                                                          text_in(*found, "units"),
                                                          text_in(*found, "standard_name"),
                                                          text_in(*found, "axis"),
                                                          text_in(*found, "positive")});
        for (const std::size_t d : found->dims) {
            c.lengths.push_back(static_cast<std::int64_t>(header.dims[d].length));
        }
    }
    return choose_positions(named, nodes);
}

std::unique_ptr<VolumeSource> open_netcdf3(const VolumeInput& input, const SourceOptions& options) {
    const std::filesystem::path& path = input.path();
    const NetcdfHeader header = read_netcdf3_header(path);
    const NetcdfVariable& v = choose(header, options, path.string());
    PlacedArray array;
    array.file = path;
    array.name = path.string() + ":" + v.name;
    set_type(v, array);
    const std::size_t value = netcdf_type_bytes(v.type);
    std::vector<std::string> notes;
    const bool minc = is_of_minc(v) && v.name == "image";
    if (is_unsigned(v) && !minc) {
        notes.emplace_back("stored numbers are read as unsigned (_Unsigned)");
    }
    array.strides = strides_of(header, v);
    // The length of a record need not be a multiple of the size of its numbers.
    array.strides_in_bytes = std::any_of(array.strides.begin(), array.strides.end(),
                                         [&](std::uint64_t bytes) { return bytes % value != 0; });
    for (std::uint64_t& stride : array.strides) {
        stride /= array.strides_in_bytes ? 1 : value;
    }
    array.steps.assign(v.dims.size(), Double3{0, 0, 0});
    for (const std::size_t d : v.dims) {
        if (header.dims[d].length < 1) {
            throw Error(ErrorKind::invalid_argument, {array.name},
                        "the unlimited dimension has no records");
        }
        array.axes.push_back(
            {header.dims[d].name, static_cast<std::int64_t>(header.dims[d].length), true});
    }
    UnevenCoordinates uneven;
    std::optional<CfPositions> at;
    ChosenAxes chosen;
    if (!minc && !options.spacing) {
        chosen = choose_axes(array.axes, options.index, array.name);
        at = find_positions(header, v, chosen);
    }
    if (at) {
        // The steps of the lattice, which the positions replace.
        for (std::size_t a = 0; a < 3; ++a) {
            array.steps[*chosen.axis.at(a)].at(a) = 1;
        }
    } else if (minc) {
        place_as_minc(path, header, v, options, array, notes);
    } else {
        place_as_cf(path, header, v, options, array, uneven, notes);
    }
    array.layout.big_endian = true;
    array.layout.packing = Packing::plain;
    array.layout.exact_length = false;
    array.layout.offset = v.begin;
    auto source = open_placed(array, options.index);
    if (at) {
        const std::size_t planes = v.dims[*chosen.axis[2]];
        NodePositionsPtr positions = cf_positions(
            *at, source->describe().nodes, coordinates_along(path, header, planes).numbers,
            [&](const std::string& variable) {
                SourceOptions own = options;
                own.dataset = variable;
                own.index.clear();
                own.labels = false;
                own.max_heap /= 4;  // there are three of them, beside the values
                own.spacing = {1, 1, 1};
                return open_netcdf3(input, own);
            },
            array.name, notes);
        source = with_positions(std::move(source), std::move(positions));
    }
    source = with_notes(with_uneven_axes(std::move(source), std::move(uneven)), std::move(notes));
    if (minc) {
        return source;
    }
    if (const auto time = time_of(path, header, v, options, array)) {
        source = with_time(std::move(source), *time);
    }
    const auto numbers = [&](const std::string& name) -> std::vector<double> {
        const NetcdfAttribute* const attribute = attribute_of(v, name);
        std::vector<double> list =
            attribute == nullptr ? std::vector<double>{} : attribute->numbers;
        if (is_unsigned(v) && name != "scale_factor" && name != "add_offset") {
            take_as_unsigned(list, value);
        }
        return list;
    };
    return scaled(std::move(source), cf_scaling(numbers, array.name));
}

}  // namespace

VolumeFormat netcdf3_format() {
    return {.about = {"NetCDF-3", ".nc .cdf .mnc", ""},
            .takes = {.dataset = true, .index = true},
            .recognises = is_netcdf3,
            .open = open_netcdf3};
}

}  // namespace isonest::detail
