#include "preprocess/sources/grids/legacy_vtk.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "store/base/escaped_text.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kLongestLine = 4096;

bool is_blank(char c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

}  // namespace

LegacyText::LegacyText(const InputFile& file) : file_(file), size_(regular_file_size(file)) {}

std::string LegacyText::line() {
    if (at_ >= size_) {
        return "";
    }
    const std::string part = first_bytes(file_, kLongestLine, at_);
    const std::size_t end = part.find('\n');
    if (end == std::string::npos && part.size() == kLongestLine) {
        throw Error(ErrorKind::corrupt, {file_.name(), fmt::format("byte {}", at_)},
                    fmt::format("no line ends within {} bytes", kLongestLine));
    }
    at_ += end == std::string::npos ? part.size() : end + 1;
    return part.substr(0, end);
}

std::vector<std::string> LegacyText::words() {
    std::vector<std::string> words;
    while (words.empty() && at_ < size_) {
        const std::string text = line();
        for (auto from = text.begin(); true;) {
            from = std::find_if_not(from, text.end(), is_blank);
            if (from == text.end()) {
                break;
            }
            const auto to = std::find_if(from, text.end(), is_blank);
            words.emplace_back(from, to);
            from = to;
        }
    }
    return words;
}

void LegacyText::skip_to_empty_line() {
    while (at_ < size_) {
        const std::string text = line();
        if (std::all_of(text.begin(), text.end(), is_blank)) {
            return;
        }
    }
}

void LegacyText::skip(std::uint64_t bytes) {
    at_ += std::min(bytes, size_ - at_);
}

void LegacyText::skip_words(std::uint64_t count) {
    constexpr std::size_t kPart = std::size_t{1} << 16U;
    bool within = false;
    while (at_ < size_) {
        const std::string part = first_bytes(file_, kPart, at_);
        if (part.empty()) {
            return;
        }
        for (const char c : part) {
            const bool blank = is_blank(c);
            if (!blank && !within) {
                if (count == 0) {
                    return;
                }
                --count;
            }
            within = !blank;
            ++at_;
        }
    }
}

void LegacyText::skip_lines(std::uint64_t count) {
    for (; count > 0 && at_ < size_; --count) {
        line();
    }
}

void LegacyText::skip_binary_texts(std::uint64_t count) {
    constexpr std::uint64_t kLengthBits = 0x3F;
    for (; count > 0 && at_ < size_; --count) {
        const std::string head = first_bytes(file_, sizeof(std::uint64_t), at_);
        if (head.empty()) {
            return;
        }
        // Two bits encode the size of the length: 8, 4, 2 or 1 bytes.
        const std::size_t bytes = std::size_t{8} >> (static_cast<unsigned char>(head[0]) >> 6U);
        std::uint64_t length = 0;
        for (std::size_t i = 0; i < std::min(bytes, head.size()); ++i) {
            const std::uint64_t byte = static_cast<unsigned char>(head[i]);
            length = (length << 8U) + (i == 0 ? byte & kLengthBits : byte);
        }
        skip(bytes);
        skip(length);
    }
}

// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html;
// vtkDataReader for what it leaves out (METADATA, how texts and bits are stored).

namespace {

constexpr std::int64_t kMaxNumber = 1'000'000'000'000'000;
/// Maximum size in bytes of the names in a message.
constexpr std::size_t kMaxList = std::size_t{1} << 16U;

class Parser {
  public:
    Parser(const InputFile& file, const std::string& wanted)
        : name_(file.name()), wanted_(wanted), text_(file) {}

    LegacyHeader read() {
        text_.line();
        text_.line();  // the title, which is ignored
        Words words = text_.words();
        header_.text = is(words, "ascii");
        if (!header_.text && !is(words, "binary")) {
            corrupt("the third line is neither ASCII nor BINARY");
        }
        while (!found_ && !(words = text_.words()).empty()) {
            read(words);
        }
        if (!found_) {
            throw Error(ErrorKind::not_found, {name_},
                        fmt::format("there is no array{}; the file has:{}",
                                    wanted_.empty() ? std::string(" of points")
                                                    : fmt::format(" '{}'", wanted_),
                                    list_.empty() ? " none" : list_),
                        wanted_.empty() ? std::vector<Remedy>{{RemedyKind::choose_dataset}}
                                        : std::vector<Remedy>{});
        }
        return header_;
    }

  private:
    using Words = std::vector<std::string>;

    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {name_, fmt::format("before byte {}", text_.at())}, what);
    }
    static bool is(const Words& words, const char* keyword) {
        return !words.empty() && lower(words[0]) == keyword;
    }
    [[nodiscard]] double number(const Words& words, std::size_t i) const {
        double value = 0;
        if (i < words.size()) {
            const std::string& word = words[i];
            const auto [end, error] =
                std::from_chars(word.data(), word.data() + word.size(), value);
            if (error == std::errc{} && end == word.data() + word.size() && std::isfinite(value)) {
                return value;
            }
        }
        corrupt(fmt::format("{:.40}: number {} is missing", words[0], i));
    }
    [[nodiscard]] Double3 three(const Words& words) const {
        return {number(words, 1), number(words, 2), number(words, 3)};
    }
    [[nodiscard]] std::int64_t whole(const Words& words, std::size_t i,
                                     std::int64_t least = 1) const {
        const double value = number(words, i);
        if (value < static_cast<double>(least) || value > static_cast<double>(kMaxNumber) ||
            value != std::floor(value)) {
            corrupt(fmt::format("{:.40}: invalid number {}", words[0], value));
        }
        return static_cast<std::int64_t>(value);
    }

    void read(const Words& words) {
        const std::string keyword = lower(words[0]);
        if (keyword == "dataset") {
            const std::string kind = words.size() < 2 ? "" : lower(words[1]);
            header_.rectilinear = kind == "rectilinear_grid";
            if (kind != "structured_points" && !header_.rectilinear) {
                throw Error(ErrorKind::unsupported, {name_},
                            "the data set is neither STRUCTURED_POINTS nor RECTILINEAR_GRID");
            }
            image_ = true;
        } else if (keyword == "dimensions") {
            header_.dimensions = {whole(words, 1), whole(words, 2), whole(words, 3)};
        } else if (keyword == "spacing" || keyword == "aspect_ratio") {
            header_.spacing = three(words);
        } else if (keyword == "origin") {
            header_.origin = three(words);
        } else if (header_.rectilinear && keyword.size() > 2 &&
                   keyword.substr(1) == "_coordinates" && keyword[0] >= 'x' && keyword[0] <= 'z') {
            read_coordinates(static_cast<std::size_t>(keyword[0] - 'x'), words);
        } else if (keyword == "point_data" || keyword == "cell_data") {
            of_cells_ = keyword == "cell_data";
            values_ = whole(words, 1);
        } else if (keyword == "field") {
            const std::int64_t arrays = words.size() > 2 ? whole(words, 2, 0) : 0;
            for (std::int64_t i = 0; i < arrays && !found_; ++i) {
                read_field_array();
            }
        } else if (keyword == "metadata") {
            text_.skip_to_empty_line();
        } else if (words.size() > 2) {
            read_attribute(keyword, words);
        }
    }
    void read_coordinates(std::size_t axis, const Words& words) {
        const std::int64_t count = whole(words, 1);
        if (words.size() < 3 || count != header_.dimensions.at(axis)) {
            corrupt(fmt::format("{:.40}: {} numbers, but DIMENSIONS has {} points along {}",
                                words[0], count, header_.dimensions.at(axis), "xyz"[axis]));
        }
        LegacyArray& array = header_.coordinates.at(axis);
        array = {std::string(1, "xyz"[axis]), lower(words[2]), 1, count, text_.at(), false, false};
        const LegacyType* const type = legacy_type(array.type);
        if (type == nullptr || type->stored) {
            throw Error(
                ErrorKind::unsupported, {name_, words[0]},
                fmt::format("coordinates of the type '{:.40}' are not supported", words[2]));
        }
        skip(array);
    }
    void read_field_array() {
        Words of = text_.words();
        if (is(of, "metadata") && of.size() == 1) {  // of the preceding array
            text_.skip_to_empty_line();
            of = text_.words();
        }
        if (of.size() < 4) {
            corrupt("an array of a field lacks its name, sizes or type");
        }
        const LegacyArray array{percent_decoded(of[0]),
                                lower(of[3]),
                                whole(of, 1, 0),
                                whole(of, 2, 0),
                                text_.at(),
                                of_cells_,
                                false};
        // Before POINT_DATA and CELL_DATA, they belong to the file.
        take(array, of[0], values_ > 0);
    }
    /// SCALARS and other attributes, each with one array.
    void read_attribute(const std::string& keyword, const Words& words) {
        LegacyArray array{
            percent_decoded(words[1]), lower(words[2]), 0, values_, 0, of_cells_, false};
        if (keyword == "scalars") {
            array.components = words.size() > 3 ? whole(words, 3) : 1;
            const Words table = text_.words();
            if (!is(table, "lookup_table")) {
                corrupt("no LOOKUP_TABLE line follows SCALARS");
            }
            if (table.size() != 2) {  // VTK then treats what follows the name as values
                corrupt("the LOOKUP_TABLE line after SCALARS must have one name");
            }
        } else if (keyword == "color_scalars") {
            array.type = "unsigned_char";
            array.components = whole(words, 2);
            array.colours = true;
        } else if (keyword == "lookup_table") {
            array.type = "unsigned_char";
            array.components = 4;
            array.tuples = whole(words, 2, 0);
        } else if (keyword == "texture_coordinates" && words.size() > 3) {
            array.components = whole(words, 2);
            array.type = lower(words[3]);
        } else {
            static constexpr std::array<std::pair<const char*, int>, 7> kParts{{{"vectors", 3},
                                                                                {"normals", 3},
                                                                                {"tensors", 9},
                                                                                {"tensors6", 6},
                                                                                {"global_ids", 1},
                                                                                {"pedigree_ids", 1},
                                                                                {"edge_flags", 1}}};
            const auto* const it =
                std::find_if(kParts.begin(), kParts.end(),
                             [&](const auto& entry) { return keyword == entry.first; });
            if (it == kParts.end()) {
                return;
            }
            array.components = it->second;
        }
        array.at = text_.at();
        take(array, words[1], keyword != "lookup_table");
    }
    void take(const LegacyArray& array, const std::string& written, bool of_image) {
        if (!image_) {
            corrupt("data come before DATASET");
        }
        if (of_image) {
            if (list_.size() < kMaxList) {
                list_ += fmt::format("\n  {:.80} {:.40}", array.name, array.type);
            }
            if (wanted_.empty() || array.name == wanted_ || written == wanted_) {
                found_ = true;
                header_.array = array;
                return;
            }
        }
        skip(array);
    }
    void skip(const LegacyArray& array) {
        const auto numbers =
            static_cast<std::uint64_t>(array.components) * static_cast<std::uint64_t>(array.tuples);
        if (array.tuples != 0 && array.components > kMaxNumber / array.tuples) {
            corrupt(fmt::format("an array of {} tuples of {} numbers is too large", array.tuples,
                                array.components));
        }
        const LegacyType* const type = legacy_type(array.type);
        if (array.type == "string") {
            header_.text ? text_.skip_lines(numbers) : text_.skip_binary_texts(numbers);
        } else if (header_.text) {
            text_.skip_words(numbers);
        } else if (array.type == "bit") {
            text_.skip((numbers + 7) / 8);
        } else if (type == nullptr) {
            throw Error(
                ErrorKind::unsupported, {name_},
                fmt::format(
                    "arrays after '{:.80}' cannot be found, because its type '{:.40}' is unknown",
                    array.name, array.type));
        } else {
            text_.skip(type->bytes() * numbers);
        }
    }

    std::string name_;
    const std::string& wanted_;
    LegacyText text_;
    LegacyHeader header_;
    bool image_ = false;
    bool of_cells_ = false;
    bool found_ = false;
    std::int64_t values_ = 0;
    std::string list_;
};

}  // namespace

const LegacyType* legacy_type(const std::string& name) {
    static constexpr std::array<LegacyType, 14> kTypes{
        {{"char", ValueType::i8, {}},
         {"signed_char", ValueType::i8, {}},
         {"unsigned_char", ValueType::u8, {}},
         {"short", ValueType::i16, {}},
         {"unsigned_short", ValueType::u16, {}},
         {"int", ValueType::i32, {}},
         {"unsigned_int", ValueType::u32, {}},
         {"vtkidtype", ValueType::i32, {}},
         {"float", ValueType::f32, {}},
         {"double", ValueType::f64, {}},
         {"long", ValueType::f64, StoredNumber::i64},
         {"vtktypeint64", ValueType::f64, StoredNumber::i64},
         {"unsigned_long", ValueType::f64, StoredNumber::u64},
         {"vtktypeuint64", ValueType::f64, StoredNumber::u64}}};
    const auto* const it = std::find_if(kTypes.begin(), kTypes.end(),
                                        [&](const LegacyType& type) { return name == type.name; });
    return it == kTypes.end() ? nullptr : it;
}

LegacyHeader read_legacy_header(const InputFile& file, const std::string& wanted) {
    return Parser(file, wanted).read();
}

namespace {

bool is_vtk(const VolumeInput& input) {
    return input.head.starts_with("# vtk DataFile Version");
}

/// The coordinates of a rectilinear grid's points along an axis.
std::vector<double> coordinates_along(const VolumeInput& input, const LegacyHeader& header,
                                      std::size_t axis) {
    const LegacyArray& array = header.coordinates.at(axis);
    const ErrorPlace place{input.name(), fmt::format("{}_COORDINATES", "XYZ"[axis])};
    if (array.tuples == 0) {
        throw Error(ErrorKind::corrupt, place, "they are missing");
    }
    const LegacyType* const type = legacy_type(array.type);  // not null: see the parser
    const auto count = static_cast<std::size_t>(array.tuples);
    // A number in text has at least a digit and a blank.
    const std::uint64_t least = count * (header.text ? 2 : type->bytes()) - (header.text ? 1 : 0);
    const std::uint64_t size = regular_file_size(input.file);
    if (array.at > size || least > size - array.at) {
        throw Error(ErrorKind::corrupt, place, "the file ends before their end");
    }
    return dispatch(type->type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        std::string bytes(count * sizeof(T), '\0');
        if (header.text) {
            text_numbers(input.file, array.at, type->type, count)
                ->read(0, reinterpret_cast<std::byte*>(bytes.data()), bytes.size());
        } else {
            bytes = first_bytes(input.file, bytes.size(), array.at);
        }
        std::vector<double> numbers;
        for (std::size_t i = 0; i < count; ++i) {
            numbers.push_back(
                static_cast<double>(number_at<T>(bytes, i * sizeof(T), !header.text)));
        }
        return numbers;
    });
}

/// REQUIRES: the array has its place.
std::unique_ptr<VolumeSource> open_numbers(PlacedArray& array, const LegacyHeader& header,
                                           const SourceOptions& options) {
    const LegacyArray& found = header.array;
    if (header.text) {
        const std::uint64_t count = place_in_array(array.axes, options.index, array.name).whole;
        return open_placed(
            array, options.index,
            array.stored
                ? text_integers(array.file, found.at, *array.stored == StoredNumber::i64, count)
                : text_numbers(array.file, found.at, array.layout.type, count));
    }
    array.layout.big_endian = true;
    array.layout.packing = Packing::plain;
    array.layout.offset = found.at;
    return open_placed(array, options.index);
}

std::unique_ptr<VolumeSource> open_vtk(const VolumeInput& input, const SourceOptions& options) {
    const LegacyHeader header = read_legacy_header(input.file, options.dataset);
    const LegacyArray& found = header.array;
    PlacedArray array;
    array.file = input.file;
    array.name = input.name() + ":" + found.name;
    if (header.text && found.colours) {
        throw Error(ErrorKind::unsupported, {array.name}, "colours as text are not supported");
    }
    const LegacyType* const type = legacy_type(found.type);
    if (type == nullptr) {
        throw Error(ErrorKind::unsupported, {array.name},
                    fmt::format("the type '{:.40}' is not supported", found.type));
    }
    array.layout.type = type->type;
    array.stored = type->stored;
    constexpr std::array<const char*, 3> kNames{"x", "y", "z"};
    array.first = header.origin;
    for (std::size_t i = 3; i-- > 0;) {
        const std::int64_t nodes = header.dimensions.at(i);
        const bool between = found.of_cells && nodes > 1;
        array.axes.push_back({kNames.at(i), between ? nodes - 1 : nodes, true});
        array.first.at(i) += between ? header.spacing.at(i) / 2 : 0;
        Double3 step{};
        step.at(i) = header.spacing.at(i);
        array.steps.push_back(step);
    }
    const std::uint64_t values = place_in_array(array.axes, {}, array.name).whole;
    if (values != static_cast<std::uint64_t>(found.tuples)) {
        throw Error(ErrorKind::corrupt, {array.name},
                    fmt::format("it has {} values, but there are [{}] {}", found.tuples,
                                text_of(array.axes), found.of_cells ? "cells" : "points"));
    }
    if (found.components > 1) {
        array.axes.push_back({"c", found.components, false});
        array.steps.push_back({0, 0, 0});
    }
    array.own_spacing = options.spacing.has_value();
    array.layout.exact_length = false;
    if (!header.rectilinear) {
        return open_numbers(array, header, options);
    }
    CoordinatePlace by = place_rectilinear(
        array, header.dimensions, found.of_cells, options,
        [&](std::size_t along) { return coordinates_along(input, header, along); });
    return with_notes(with_uneven_axes(open_numbers(array, header, options), std::move(by.uneven)),
                      std::move(by.notes));
}

}  // namespace

VolumeFormat vtk_format() {
    return {.about = {"VTK legacy image or rectilinear grid", ".vtk", ""},
            .takes = {.dataset = true, .index = true},
            .reads_urls = true,
            .recognises = is_vtk,
            .open = open_vtk};
}

}  // namespace isonest::detail
