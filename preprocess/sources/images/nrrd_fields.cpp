// Source: http://teem.sourceforge.net/nrrd/format.html

#include "preprocess/sources/images/nrrd_fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <iterator>
#include <map>
#include <sstream>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/numbers/raw_source.h"

namespace isonest::detail {

std::optional<NrrdType> nrrd_type(const std::string& name) {
    static const std::map<std::string, NrrdType> types{
        {"signed char", {ValueType::i8}},
        {"int8", {ValueType::i8}},
        {"int8_t", {ValueType::i8}},
        {"char", {ValueType::i8}},
        {"uchar", {ValueType::u8}},
        {"unsigned char", {ValueType::u8}},
        {"uint8", {ValueType::u8}},
        {"uint8_t", {ValueType::u8}},
        {"short", {ValueType::i16}},
        {"short int", {ValueType::i16}},
        {"signed short", {ValueType::i16}},
        {"signed short int", {ValueType::i16}},
        {"int16", {ValueType::i16}},
        {"int16_t", {ValueType::i16}},
        {"ushort", {ValueType::u16}},
        {"unsigned short", {ValueType::u16}},
        {"unsigned short int", {ValueType::u16}},
        {"uint16", {ValueType::u16}},
        {"uint16_t", {ValueType::u16}},
        {"int", {ValueType::i32}},
        {"signed int", {ValueType::i32}},
        {"int32", {ValueType::i32}},
        {"int32_t", {ValueType::i32}},
        {"uint", {ValueType::u32}},
        {"unsigned int", {ValueType::u32}},
        {"uint32", {ValueType::u32}},
        {"uint32_t", {ValueType::u32}},
        {"float", {ValueType::f32}},
        {"double", {ValueType::f64}},
        {"longlong", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"long long", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"long long int", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"signed long long", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"signed long long int", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"int64", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"int64_t", {bits_type(StoredNumber::i64), StoredNumber::i64}},
        {"ulonglong", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"unsigned long long", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"unsigned long long int", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"uint64", {bits_type(StoredNumber::u64), StoredNumber::u64}},
        {"uint64_t", {bits_type(StoredNumber::u64), StoredNumber::u64}}};
    const auto it = types.find(name);
    return it == types.end() ? std::nullopt : std::optional(it->second);
}

namespace {

/// All fields of the format. They may be written without their spaces.
constexpr std::array kFields{"content",         "number",       "type",
                             "block size",      "dimension",    "space",
                             "space dimension", "sizes",        "spacings",
                             "thicknesses",     "axis mins",    "axis maxs",
                             "centers",         "kinds",        "labels",
                             "units",           "min",          "max",
                             "old min",         "old max",      "data file",
                             "endian",          "encoding",     "line skip",
                             "byte skip",       "sample units", "space directions",
                             "space units",     "space origin", "measurement frame"};

std::string without_spaces(std::string text) {
    std::erase(text, ' ');
    return text;
}

/// The name in kFields; empty if there is none.
std::string field_of(std::string_view text) {
    const std::string key = without_spaces(lower(text));
    if (key == "centerings") {
        return "centers";
    }
    const auto* const it = std::find_if(kFields.begin(), kFields.end(), [&](const char* field) {
        return without_spaces(field) == key;
    });
    return it == kFields.end() ? std::string{} : *it;
}

std::string_view trim(std::string_view s) {
    const auto from = s.find_first_not_of(" \t\r");
    const auto to = s.find_last_not_of(" \t\r");
    return from == std::string_view::npos ? std::string_view{} : s.substr(from, to - from + 1);
}

/// The value of a key: replaces \n and \\ by a line break and a backslash.
std::string unescaped(std::string_view text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const bool escaped =
            text[i] == '\\' && i + 1 < text.size() && (text[i + 1] == 'n' || text[i + 1] == '\\');
        i += escaped ? 1 : 0;
        out += escaped && text[i] == 'n' ? '\n' : text[i];
    }
    return out;
}

std::vector<std::string> split_words(std::string_view text) {
    std::istringstream in{std::string(text)};
    return {std::istream_iterator<std::string>(in), {}};
}

/// A line without its line end; `at` moves past it.
std::string_view next_line(std::string_view text, std::size_t& at) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string_view line = text.substr(at, end - at);
    at = std::min(end + 1, text.size());
    if (line.ends_with('\r')) {
        line.remove_suffix(1);
    }
    return line;
}

}  // namespace

NrrdFields::NrrdFields(std::string_view text, std::string name) : name_(std::move(name)) {
    std::size_t at = 0;
    next_line(text, at);
    for (std::size_t number = 2; at < text.size(); ++number) {
        const std::string_view line = next_line(text, at);
        if (line.empty()) {
            bytes_ = at;
            break;
        }
        if (line.find('\r') != std::string_view::npos) {
            corrupt(
                fmt::format("line {} contains a carriage return, which only some programs take for "
                            "the end of a line",
                            number));
        }
        add(line, number);
        if (lists_files()) {  // names of files follow
            while (at < text.size()) {
                const std::string_view file = next_line(text, at);
                if (file.empty()) {
                    break;
                }
                listed_.emplace_back(file);
            }
            break;
        }
    }
}

void NrrdFields::add(std::string_view line, std::size_t number) {
    if (line[0] == '#') {
        return;
    }
    std::size_t colon = line.find(": ");
    if (colon == std::string_view::npos && line.ends_with(':')) {
        colon = line.size() - 1;
    }
    const std::string field =
        colon == std::string_view::npos ? std::string{} : field_of(trim(line.substr(0, colon)));
    if (field.empty()) {
        const std::size_t sign = line.find(":=");
        if (line.starts_with("Segment") && sign != std::string_view::npos) {
            segment_keys_.insert_or_assign(std::string(line.substr(0, sign)),
                                           unescaped(line.substr(sign + 2)));
        }
        if (sign == std::string_view::npos) {
            constexpr std::size_t kShown = 40;
            const std::string_view shown = line.substr(0, kShown);
            const bool text = std::all_of(shown.begin(), shown.end(),
                                          [](char c) { return c >= ' ' && c <= '~'; });
            corrupt(
                fmt::format("line {}{} is neither a known field ('name: value'), nor 'key:=value', "
                            "nor a comment",
                            number, text ? fmt::format(", '{}',", shown) : std::string{}));
        }
        return;
    }
    const std::string_view value = trim(line.substr(colon + 1));
    if (!fields_.emplace(field, value).second) {
        corrupt(fmt::format("duplicate field '{}' on line {}", field, number));
    }
}

bool NrrdFields::lists_files() const {
    const std::string* const file = find("data file");
    return file != nullptr && (*file == "LIST" || file->starts_with("LIST "));
}

std::optional<NrrdFields::Pieces> NrrdFields::pieces() const {
    const std::string* const field = find("data file");
    if (field == nullptr) {
        return std::nullopt;
    }
    const std::vector<std::string> words = split_words(*field);
    Pieces pieces;
    if (lists_files()) {
        if (words.size() > 2) {
            corrupt(fmt::format(
                "'data file: {}': only the number of axes of a file may follow LIST", *field));
        }
        if (words.size() == 2) {
            pieces.axes = integer("data file", words[1]);
        }
        pieces.files = listed_;
        if (pieces.files.empty() || pieces.files.size() > kMaxPieces) {
            corrupt(fmt::format("'data file: LIST' lists {} files, which is none or too many",
                                pieces.files.size()));
        }
        return pieces;
    }
    // "v%03d.raw 1 20 1 2": a pattern; first number, last number and step; the number of axes.
    const auto is_number = [](const std::string& word) {
        return word.find_first_not_of("+-0123456789") == std::string::npos;
    };
    if (words.size() < 4 || words.size() > 5 || !is_numbered(words[0]) ||
        !std::all_of(words.begin() + 1, words.end(), is_number)) {
        return std::nullopt;
    }
    pieces.files = numbered_names(words[0], integer("data file", words[1]),
                                  integer("data file", words[2]), integer("data file", words[3]));
    if (pieces.files.empty()) {
        corrupt(fmt::format("'data file: {}' names no files, or more than {}", *field, kMaxPieces));
    }
    if (words.size() == 5) {
        pieces.axes = integer("data file", words[4]);
    }
    return pieces;
}

void NrrdFields::corrupt(const std::string& what) const {
    throw Error(ErrorKind::corrupt, {name_, "NRRD header"}, what);
}

void NrrdFields::unsupported(const std::string& what) const {
    throw Error(ErrorKind::unsupported, {name_, "NRRD header"}, what);
}

const std::string* NrrdFields::find(const char* field) const {
    const auto it = fields_.find(field);
    return it == fields_.end() ? nullptr : &it->second;
}

const std::string& NrrdFields::require(const char* field) const {
    const std::string* const value = find(field);
    if (value == nullptr) {
        corrupt(fmt::format("the field '{}' is missing", field));
    }
    return *value;
}

std::vector<std::string> NrrdFields::words(const char* field) const {
    const std::string* const text = find(field);
    return text == nullptr ? std::vector<std::string>{} : split_words(lower(*text));
}

std::vector<std::string> NrrdFields::quoted(const char* field) const {
    std::vector<std::string> texts;
    const std::string* const found = find(field);
    bool inside = false;
    for (const char c : found == nullptr ? std::string_view{} : std::string_view(*found)) {
        if (c == '"') {
            inside = !inside;
            if (inside) {
                texts.emplace_back();
            }
        } else if (inside) {
            texts.back() += c;
        }
    }
    return texts;
}

double NrrdFields::number(const char* field, std::string_view word) const {
    const std::string_view digits =
        word.starts_with('+') && !word.starts_with("+-") ? word.substr(1) : word;
    double value = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error == std::errc::result_out_of_range) {
        corrupt(fmt::format("'{}': {} is out of the range of 64-bit floats", field, word));
    }
    if (error != std::errc{} || end != digits.data() + digits.size()) {
        corrupt(fmt::format("'{}': '{}' is not a number", field, word));
    }
    return value;
}

std::vector<double> NrrdFields::numbers(const char* field) const {
    std::vector<double> out;
    for (const std::string& word : words(field)) {
        out.push_back(number(field, word));
    }
    return out;
}

std::int64_t NrrdFields::integer(const char* field, std::string_view word) const {
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc{} || end != word.data() + word.size()) {
        corrupt(fmt::format("'{}': '{}' is not a whole number of 64 bits", field, word));
    }
    return value;
}

std::vector<std::int64_t> NrrdFields::integers(const char* field) const {
    std::vector<std::int64_t> out;
    for (const std::string& word : split_words(require(field))) {
        out.push_back(integer(field, word));
    }
    return out;
}

std::vector<std::vector<double>> NrrdFields::vectors(const char* field) const {
    std::vector<std::vector<double>> out;
    const std::string* const found = find(field);
    std::string_view text = found == nullptr ? std::string_view{} : *found;
    std::size_t length = 0;
    while (!(text = trim(text)).empty()) {
        if (lower(text.substr(0, 4)) == "none") {
            out.emplace_back();
            text.remove_prefix(4);
            continue;
        }
        const std::size_t end = text.find(')');
        if (text[0] != '(' || end == std::string_view::npos) {
            corrupt(fmt::format("'{}': '{}' is not a vector", field, *found));
        }
        std::string_view inside = text.substr(1, end - 1);
        text.remove_prefix(end + 1);
        std::vector<double>& vector = out.emplace_back();
        while (true) {
            const std::size_t comma = std::min(inside.find(','), inside.size());
            vector.push_back(number(field, trim(inside.substr(0, comma))));
            if (comma == inside.size()) {
                break;
            }
            inside.remove_prefix(comma + 1);
        }
        length = length == 0 ? vector.size() : length;
        if (vector.size() != length) {
            corrupt(fmt::format(
                "'{}' has vectors of {} and of {} numbers, but all must have the same length",
                field, length, vector.size()));
        }
    }
    return out;
}

}  // namespace isonest::detail
