// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html, and for what
// it leaves out (METADATA, how texts and bits are stored) vtkDataReader.
#include "preprocess/sources/vtk/legacy_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/lower_case.h"
#include "preprocess/sources/vtk/legacy_text.h"
#include "store/base/percent_text.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kMostNumber = 1'000'000'000'000'000;
constexpr std::size_t kMostList = std::size_t{1} << 16U;  ///< bytes of names for a message

class Parser {
  public:
    Parser(const InputFile& file, const std::string& wanted)
        : name_(file.name()), wanted_(wanted), text_(file) {}

    LegacyHeader read() {
        text_.line();
        text_.line();  // the title, whatever it is
        Words words = text_.words();
        header_.text = is(words, "ascii");
        if (!header_.text && !is(words, "binary")) {
            corrupt("neither ASCII nor BINARY");
        }
        while (!found_ && !(words = text_.words()).empty()) {
            read(words);
        }
        if (!found_) {
            throw Error(ErrorKind::not_found, {name_},
                        fmt::format("there is no array '{}'; the file has:{}", wanted_,
                                    list_.empty() ? " none" : list_),
                        {{RemedyKind::choose_dataset}});
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
        if (value < static_cast<double>(least) || value > static_cast<double>(kMostNumber) ||
            value != std::floor(value)) {
            corrupt(fmt::format("{:.40}: {} is not possible", words[0], value));
        }
        return static_cast<std::int64_t>(value);
    }

    void read(const Words& words) {
        const std::string keyword = lower(words[0]);
        if (keyword == "dataset") {
            if (words.size() < 2 || lower(words[1]) != "structured_points") {
                throw Error(ErrorKind::unsupported, {name_},
                            "it is no image: STRUCTURED_POINTS are read");
            }
            image_ = true;
        } else if (keyword == "dimensions") {
            header_.dimensions = {whole(words, 1), whole(words, 2), whole(words, 3)};
        } else if (keyword == "spacing" || keyword == "aspect_ratio") {
            header_.spacing = three(words);
        } else if (keyword == "origin") {
            header_.origin = three(words);
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
    void read_field_array() {
        Words of = text_.words();
        if (is(of, "metadata") && of.size() == 1) {  // of the array before
            text_.skip_to_empty_line();
            of = text_.words();
        }
        if (of.size() < 4) {
            corrupt("an array of a field has no name, sizes and type");
        }
        const LegacyArray array{percent_decoded(of[0]),
                                lower(of[3]),
                                whole(of, 1, 0),
                                whole(of, 2, 0),
                                text_.at(),
                                of_cells_,
                                false};
        // Before POINT_DATA and CELL_DATA, they are of the file.
        take(array, of[0], values_ > 0);
    }
    /// SCALARS and other kinds of data, each one array.
    void read_attribute(const std::string& keyword, const Words& words) {
        LegacyArray array{
            percent_decoded(words[1]), lower(words[2]), 0, values_, 0, of_cells_, false};
        if (keyword == "scalars") {
            array.components = words.size() > 3 ? whole(words, 3) : 1;
            const Words table = text_.words();
            if (!is(table, "lookup_table")) {
                corrupt("no LOOKUP_TABLE line follows SCALARS");
            }
            if (table.size() != 2) {  // VTK takes what follows the name for values
                corrupt("the LOOKUP_TABLE line behind SCALARS has more or less than one name");
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
            corrupt("numbers come before DATASET");
        }
        if (of_image) {
            if (list_.size() < kMostList) {
                list_ += fmt::format("\n  {:.80} {:.40}", array.name, array.type);
            }
            if (wanted_.empty() || array.name == wanted_ || written == wanted_) {
                found_ = true;
                header_.array = array;
                return;
            }
        }
        const auto numbers =
            static_cast<std::uint64_t>(array.components) * static_cast<std::uint64_t>(array.tuples);
        if (array.tuples != 0 && array.components > kMostNumber / array.tuples) {
            corrupt(fmt::format("{} tuples of {} numbers", array.tuples, array.components));
        }
        const LegacyType* const type = legacy_type(array.type);
        if (array.type == "string") {
            header_.text ? text_.skip_lines(numbers) : text_.skip_binary_texts(numbers);
        } else if (header_.text) {
            text_.skip_words(numbers);
        } else if (array.type == "bit") {
            text_.skip((numbers + 7) / 8);
        } else if (type == nullptr) {
            throw Error(ErrorKind::unsupported, {name_},
                        fmt::format("arrays behind '{:.80}' cannot be found: it is of type "
                                    "'{:.40}'",
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

}  // namespace isonest::detail
