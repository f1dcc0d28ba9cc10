#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <span>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMaxHeader = std::size_t{1} << 20U;

std::string_view stripped(std::string_view text) {
    const auto from = text.find_first_not_of(" \t\r");
    const auto to = text.find_last_not_of(" \t\r");
    return from == std::string_view::npos ? std::string_view{} : text.substr(from, to - from + 1);
}

/// "Key = Value" lines; the last key is ElementDataFile.
class Header {
  public:
    Header(std::string_view text, std::string name) : name_(std::move(name)) {
        while (bytes_ < text.size() && values_.find("ElementDataFile") == values_.end()) {
            const std::size_t end = text.find('\n', bytes_);
            if (end == std::string_view::npos && text.size() >= kMaxHeader) {
                break;
            }
            const std::string_view line = text.substr(bytes_, std::min(end, text.size()) - bytes_);
            const std::size_t sign = line.find('=');
            if (sign == std::string_view::npos && !stripped(line).empty()) {
                corrupt(fmt::format("line '{:.60}' is not 'Key = Value'", stripped(line)));
            }
            if (sign != std::string_view::npos) {
                values_[std::string(stripped(line.substr(0, sign)))] =
                    stripped(line.substr(sign + 1));
            }
            bytes_ = end == std::string_view::npos ? text.size() : end + 1;
        }
        if (values_.find("ElementDataFile") == values_.end()) {
            corrupt("ElementDataFile is missing");
        }
    }
    [[nodiscard]] std::size_t bytes() const { return bytes_; }
    /// Empty if there is no such key.
    [[nodiscard]] std::string text(std::initializer_list<const char*> keys) const {
        for (const char* const key : keys) {
            if (const auto it = values_.find(key); it != values_.end()) {
                return it->second;
            }
        }
        return "";
    }
    [[nodiscard]] bool flag(std::initializer_list<const char*> keys) const {
        const std::string value = text(keys);
        return value == "True" || value == "true" || value == "TRUE" || value == "1";
    }
    /// Empty if there is no such key.
    [[nodiscard]] std::vector<double> numbers(std::initializer_list<const char*> keys,
                                              std::size_t count) const {
        const std::string all = text(keys);
        std::vector<double> numbers;
        std::istringstream words(all);
        for (std::string word; words >> word;) {
            double value = 0;
            const auto [end, error] =
                std::from_chars(word.data(), word.data() + word.size(), value);
            if (error != std::errc{} || end != word.data() + word.size() || !std::isfinite(value)) {
                corrupt(fmt::format("{}: '{}' is not a number", *keys.begin(), word));
            }
            numbers.push_back(value);
        }
        if (!numbers.empty() && numbers.size() != count) {
            corrupt(fmt::format("{} has {} numbers, not {}", *keys.begin(), numbers.size(), count));
        }
        return numbers;
    }
    [[nodiscard]] std::int64_t integer(const char* key, std::int64_t otherwise) const {
        const std::vector<double> value = numbers({key}, 1);
        if (!value.empty() && (value[0] != std::floor(value[0]) || std::fabs(value[0]) > 1e15)) {
            corrupt(fmt::format("{} = {} is not a whole number", key, value[0]));
        }
        return value.empty() ? otherwise : static_cast<std::int64_t>(value[0]);
    }
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {name_, "MetaImage header"}, what);
    }
    [[noreturn]] void unsupported(const std::string& what) const {
        throw Error(ErrorKind::unsupported, {name_, "MetaImage header"}, what);
    }

  private:
    std::string name_;
    std::map<std::string, std::string> values_;
    std::size_t bytes_ = 0;
};

bool is_meta_image(const VolumeInput& input) {
    if (input.folder) {
        return false;
    }
    // The keys may come in any order, but files begin with one of these.
    for (const char* const key : {"ObjectType", "NDims", "Comment"}) {
        if (input.head.starts_with(key) && input.head.find('=') != std::string::npos) {
            const std::string_view line =
                stripped(std::string_view(input.head).substr(std::string_view(key).size()));
            if (line.starts_with('=')) {
                return input.head.find("NDims") != std::string::npos ||
                       input.head.find("Image") != std::string::npos;
            }
        }
    }
    return false;
}

void set_type(const Header& header, PlacedArray& array) {
    static const std::map<std::string, ValueType> types{
        {"MET_CHAR", ValueType::i8},   {"MET_UCHAR", ValueType::u8},
        {"MET_SHORT", ValueType::i16}, {"MET_USHORT", ValueType::u16},
        {"MET_INT", ValueType::i32},   {"MET_UINT", ValueType::u32},
        {"MET_FLOAT", ValueType::f32}, {"MET_DOUBLE", ValueType::f64}};
    const std::string type = header.text({"ElementType"});
    if (const auto it = types.find(type); it != types.end()) {
        array.layout.type = it->second;
    } else if (type == "MET_LONG_LONG" || type == "MET_ULONG_LONG") {
        array.stored = type == "MET_LONG_LONG" ? StoredNumber::i64 : StoredNumber::u64;
    } else {
        // MET_LONG has 32 or 64 bits, depending on the machine that wrote the file.
        header.unsupported(fmt::format(
            "ElementType '{}' is not supported; integers of 8 to 64 bits, float and double are",
            type));
    }
}

void set_axes(const Header& header, PlacedArray& array) {
    constexpr std::int64_t kMaxAxes = 10;
    const std::int64_t dims = header.integer("NDims", 0);
    if (dims < 1 || dims > kMaxAxes) {
        header.corrupt(fmt::format("NDims = {} is out of range", dims));
    }
    const auto count = static_cast<std::size_t>(dims);
    const std::vector<double> sizes = header.numbers({"DimSize"}, count);
    if (sizes.empty()) {
        header.corrupt("DimSize is missing");
    }
    constexpr std::array<const char*, 4> kNames{"x", "y", "z", "t"};
    for (std::size_t i = count; i-- > 0;) {
        if (sizes[i] < 1 || sizes[i] != std::floor(sizes[i]) || sizes[i] > 1e15) {
            header.corrupt(fmt::format("DimSize has the invalid length {}", sizes[i]));
        }
        array.axes.push_back({i < kNames.size() ? kNames.at(i) : fmt::format("axis{}", i),
                              static_cast<std::int64_t>(sizes[i]), i < 3});
    }
    std::vector<double> spacing = header.numbers({"ElementSpacing"}, count);
    if (spacing.empty()) {
        spacing = header.numbers({"ElementSize"}, count);
    }
    spacing.resize(count, 1);
    std::vector<double> offset = header.numbers({"Offset", "Position", "Origin"}, count);
    offset.resize(std::max<std::size_t>(count, 3), 0);
    const std::vector<double> matrix =
        header.numbers({"TransformMatrix", "Rotation", "Orientation"}, count * count);
    array.first = {offset[0], offset[1], offset[2]};
    for (std::size_t i = count; i-- > 0;) {
        Double3 step{0, 0, 0};
        for (std::size_t w = 0; w < std::min<std::size_t>(3, count) && i < 3; ++w) {
            const double along = matrix.empty() ? (i == w ? 1 : 0) : matrix[i * count + w];
            step.at(w) = along * spacing[i];
        }
        array.steps.push_back(step);
        array.apart.push_back(std::fabs(spacing[i]));
    }
    const std::int64_t channels = header.integer("ElementNumberOfChannels", 1);
    if (channels < 1) {
        header.corrupt(fmt::format("ElementNumberOfChannels = {} is less than 1", channels));
    }
    if (channels > 1) {
        array.axes.push_back({"c", channels, false});
        array.steps.push_back({0, 0, 0});
        array.apart.push_back(1);
    }
}

/// ITK, and therefore 3D Slicer and ITK-SNAP, takes the world of every volume as LPS, whether the
/// header has an AnatomicalOrientation or not: they write it from the TransformMatrix, and read
/// only the latter. Files without a patient, such as those of VTK's writer, have "???" there.
AnatomicalFrame frame_of(const Header& header) {
    return header.integer("NDims", 0) >= 3 &&
                   header.text({"AnatomicalOrientation"}).find('?') == std::string::npos
               ? AnatomicalFrame::lps
               : AnatomicalFrame::unknown;
}

/// VTK and ITK do not apply these either.
std::vector<std::string> notes_of(const Header& header) {
    const std::string slope = header.text({"ElementToIntensityFunctionSlope"});
    const std::string offset = header.text({"ElementToIntensityFunctionOffset"});
    const auto is = [](const std::string& text, double neutral) {
        double value = neutral;
        std::from_chars(text.data(), text.data() + text.size(), value);
        return value == neutral;
    };
    if (is(slope, 1) && is(offset, 0)) {
        return {};
    }
    return {
        fmt::format("values are as stored: ElementToIntensityFunction (slope {}, offset {}) is "
                    "not applied",
                    slope.empty() ? "1" : slope, offset.empty() ? "0" : offset)};
}

/// The number of axes, from the fastest, that each of several files contains.
std::size_t axes_of_piece(const Header& header) {
    const std::int64_t dims = header.integer("NDims", 0);
    std::istringstream words(header.text({"ElementDataFile"}));
    std::string word;
    words >> word;
    if (word != "LIST" || !(words >> word)) {  // "LIST 2D"
        return static_cast<std::size_t>(dims - 1);
    }
    std::int64_t own = 0;
    std::from_chars(word.data(), word.data() + word.size(), own);
    if (own < 1 || own > dims) {
        header.corrupt(
            fmt::format("ElementDataFile: '{}' is not a number of axes from 1 to {}", word, dims));
    }
    return static_cast<std::size_t>(own);
}

/// The files of `ElementDataFile = LIST`, which follow that line, or of a pattern and numbers
/// ("slice%03d.raw 1 20 1"); empty if it names a single file.
std::vector<std::string> pieces_of(const Header& header, const InputFile& file) {
    const std::string text = header.text({"ElementDataFile"});
    if (text == "LIST" || text.starts_with("LIST ")) {
        constexpr std::size_t kMaxList = std::size_t{1} << 24U;
        std::istringstream lines(first_bytes(file, kMaxList, header.bytes()));
        std::vector<std::string> names;
        for (std::string line; std::getline(lines, line);) {
            if (!stripped(line).empty()) {
                names.emplace_back(stripped(line));
            }
        }
        if (names.empty() || names.size() > kMaxPieces) {
            header.corrupt(fmt::format(
                "ElementDataFile = LIST lists {} files, which is none or too many", names.size()));
        }
        return names;
    }
    std::istringstream in(text);
    std::string pattern;
    in >> pattern;
    std::vector<std::int64_t> given;
    for (std::string word; in >> word;) {
        std::int64_t number = 0;
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
        if (error != std::errc{} || end != word.data() + word.size()) {
            return {};  // a name with blanks
        }
        given.push_back(number);
    }
    if (given.empty() || given.size() > 3 || !is_numbered(pattern)) {
        return {};
    }
    const auto sizes =
        header.numbers({"DimSize"}, static_cast<std::size_t>(header.integer("NDims", 0)));
    const std::int64_t last =
        given.size() > 1 ? given[1] : given[0] + static_cast<std::int64_t>(sizes.back()) - 1;
    std::vector<std::string> names =
        numbered_names(pattern, given[0], last, given.size() > 2 ? given[2] : 1);
    if (names.empty()) {
        header.corrupt(
            fmt::format("ElementDataFile = {} names no files, or more than {}", text, kMaxPieces));
    }
    return names;
}

std::unique_ptr<VolumeSource> open_pieces(const Header& header, const InputFile& file,
                                          const std::vector<std::string>& names, PlacedArray& array,
                                          std::span<const AxisIndex> index) {
    const std::size_t own = axes_of_piece(header);
    const auto sizes =
        header.numbers({"DimSize"}, static_cast<std::size_t>(header.integer("NDims", 0)));
    double needed = 1;
    for (std::size_t i = own; i < sizes.size(); ++i) {
        needed *= sizes[i];
    }
    if (needed != static_cast<double>(names.size())) {
        header.corrupt(
            fmt::format("ElementDataFile names {} files of {} axes, but DimSize needs {}",
                        names.size(), own, needed));
    }
    const std::vector<InputFile> files = pieces_beside(file, names);
    RawLayout& layout = array.layout;
    const std::int64_t skip = header.integer("HeaderSize", 0);
    layout.offset_from_end = skip == -1;
    layout.start = static_cast<std::uint64_t>(std::max<std::int64_t>(skip, 0));
    layout.packing = !header.flag({"CompressedData"})       ? Packing::plain
                     : is_gzip(files.front(), layout.start) ? Packing::gzip
                                                            : Packing::zlib;
    const std::uint64_t values = place_in_array(array.axes, index, array.name).whole;
    const ValueType type = array.stored ? bits_type(*array.stored) : layout.type;
    auto bytes = bytes_of_pieces(files, layout, values / names.size() * size_of(type));
    layout.start = 0;
    layout.offset_from_end = false;
    layout.header = file;
    layout.others.assign(files.begin() + 1, files.end());
    array.file = files.front();
    return open_placed(array, index, std::move(bytes));
}

std::unique_ptr<VolumeSource> noted(std::unique_ptr<VolumeSource> source, const Header& header,
                                    const SourceOptions& options) {
    source = with_notes(std::move(source), notes_of(header));
    return header.text({"ElementSpacing", "ElementSize"}).empty()
               ? without_spacing(std::move(source), options)
               : std::move(source);
}

std::unique_ptr<VolumeSource> open_meta_image(const VolumeInput& input,
                                              const SourceOptions& options) {
    const Header header(first_bytes(input.file, kMaxHeader), input.name());
    PlacedArray array;
    array.file = input.file;
    array.name = input.name();
    set_type(header, array);
    set_axes(header, array);
    RawLayout& layout = array.layout;
    layout.frame = frame_of(header);
    if (options.spacing) {
        array.own_spacing = true;
        layout.frame = AnatomicalFrame::unknown;  // its axes are lost with the matrix
    }
    layout.big_endian = header.flag({"BinaryDataByteOrderMSB", "ElementByteOrderMSB"});
    layout.exact_length = false;
    // MetaIO writes ?, um, mm or cm; files of ITK have no such line, whatever unit ITK assumes.
    layout.unit = length_unit_from(header.text({"DistanceUnits"}));
    const std::string binary = header.text({"BinaryData"});
    if (!binary.empty() && !header.flag({"BinaryData"})) {
        header.unsupported("numbers as text (BinaryData = False) are not supported");
    }
    const std::string file = header.text({"ElementDataFile"});
    if (file.empty()) {
        header.corrupt("ElementDataFile names no file");
    }
    const std::vector<std::string> pieces = pieces_of(header, input.file);
    if (!pieces.empty()) {
        return noted(open_pieces(header, input.file, pieces, array, options.index), header,
                     options);
    }
    if (file == "LOCAL" || file == "Local" || file == "local") {
        layout.start = header.bytes();
    } else {
        array.file = input.file.beside(file);
        array.name = array.file.name();
        layout.header = input.file;
        const std::int64_t skip = header.integer("HeaderSize", 0);
        layout.offset_from_end = skip == -1;
        layout.start = static_cast<std::uint64_t>(std::max<std::int64_t>(skip, 0));
    }
    layout.packing = Packing::plain;
    if (header.flag({"CompressedData"})) {
        regular_file_size(array.file);
        layout.packing = is_gzip(array.file, layout.start) ? Packing::gzip : Packing::zlib;
    }
    return noted(open_placed(array, options.index), header, options);
}

}  // namespace

VolumeFormat meta_image_format() {
    return {.about = {"MetaImage", ".mha .mhd", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_meta_image,
            .open = open_meta_image};
}

}  // namespace isonest::detail
