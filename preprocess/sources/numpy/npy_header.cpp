// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
#include "preprocess/sources/numpy/npy_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_number.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kNpyMagic = 6;
constexpr std::size_t kNpyFirst = 12;  ///< bytes before the literal, at most
constexpr std::string_view kLiteralBlanks = " \t\r\n";

/// The literal of a Python dictionary: {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }
class Literal {
  public:
    Literal(std::string_view text, const std::string& name) : text_(text), name_(name) {}

    NpyHeader parse() {
        NpyHeader header;
        expect('{');
        while (!accept('}')) {
            const std::string key = quoted();
            expect(':');
            if (key == "descr") {
                set_type(header);
            } else if (key == "fortran_order") {
                const std::string_view truth = word();
                if (truth != "True" && truth != "False") {
                    corrupt(fmt::format("'fortran_order' is '{:.40}'", truth));
                }
                header.fortran = truth == "True";
            } else if (key == "shape") {
                set_shape(header);
                has_shape_ = true;
            } else {
                corrupt(fmt::format("there is a key '{:.40}'", key));
            }
            if (!accept(',')) {
                expect('}');
                break;
            }
        }
        if (!has_type_ || !has_shape_) {
            corrupt("'descr' or 'shape' is missing");
        }
        return header;
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {name_, "npy header"}, what);
    }
    void skip_blanks() {
        at_ = std::min(text_.find_first_not_of(kLiteralBlanks, at_), text_.size());
    }
    bool accept(char c) {
        skip_blanks();
        if (at_ < text_.size() && text_[at_] == c) {
            ++at_;
            return true;
        }
        return false;
    }
    void expect(char c) {
        if (!accept(c)) {
            corrupt(fmt::format("'{}' is missing at byte {}", c, at_));
        }
    }
    std::string quoted() {
        skip_blanks();
        const char mark = at_ < text_.size() && text_[at_] == '"' ? '"' : '\'';
        expect(mark);
        const std::size_t end = text_.find(mark, at_);
        if (end == std::string_view::npos) {
            corrupt("a quotation has no end");
        }
        std::string word(text_.substr(at_, end - at_));
        at_ = end + 1;
        return word;
    }
    std::string_view word() {
        skip_blanks();
        const std::size_t from = at_;
        while (at_ < text_.size() && text_[at_] != ',' && text_[at_] != '}' && text_[at_] != ')') {
            ++at_;
        }
        const std::string_view whole = text_.substr(from, at_ - from);
        return whole.substr(0, whole.find_last_not_of(kLiteralBlanks) + 1);
    }
    void set_type(NpyHeader& header) {
        skip_blanks();
        if (at_ < text_.size() && text_[at_] == '[') {
            throw Error(ErrorKind::unsupported, {name_, "npy header"},
                        "records of several fields; save the field that is the volume");
        }
        const std::string descr = quoted();
        static const std::map<std::string_view, ValueType> types{
            {"u1", ValueType::u8},  {"b1", ValueType::u8},  {"i1", ValueType::i8},
            {"u2", ValueType::u16}, {"i2", ValueType::i16}, {"u4", ValueType::u32},
            {"i4", ValueType::i32}, {"f4", ValueType::f32}, {"f8", ValueType::f64}};
        static const std::map<std::string_view, StoredNumber> others{
            {"f2", StoredNumber::f16}, {"i8", StoredNumber::i64}, {"u8", StoredNumber::u64}};
        const std::string_view kind = descr.empty() ? "" : std::string_view(descr).substr(1);
        const bool ordered = descr.starts_with('<') || descr.starts_with('>') ||
                             descr.starts_with('|') || descr.starts_with('=');
        const auto type = types.find(kind);
        const auto other = others.find(kind);
        if (!ordered || (type == types.end() && other == others.end())) {
            throw Error(ErrorKind::unsupported, {name_, "npy header"},
                        fmt::format("numbers of type '{:.40}': integers and floating point "
                                    "numbers of up to 64 bits are read",
                                    descr));
        }
        header.big_endian = descr[0] == '>';
        if (type != types.end()) {
            header.type = type->second;
        } else {
            header.stored = other->second;
        }
        has_type_ = true;
    }
    void set_shape(NpyHeader& header) {
        constexpr std::size_t kMostAxes = 64;
        expect('(');
        while (!accept(')')) {
            std::string_view number = word();
            if (number.ends_with('L')) {  // as Python 2 wrote long integers
                number.remove_suffix(1);
            }
            std::int64_t length = 0;
            const auto [end, error] =
                std::from_chars(number.data(), number.data() + number.size(), length);
            if (error != std::errc{} || end != number.data() + number.size() || length < 0 ||
                header.shape.size() >= kMostAxes) {
                corrupt(fmt::format("an axis of length '{:.40}'", number));
            }
            if (length == 0) {
                throw Error(ErrorKind::invalid_argument, {name_}, "the array is empty");
            }
            header.shape.push_back(length);
            if (!accept(',')) {
                expect(')');
                break;
            }
        }
    }

    std::string_view text_;
    const std::string& name_;
    std::size_t at_ = 0;
    bool has_type_ = false;
    bool has_shape_ = false;
};

/// Behind the literal's length, which has two bytes in version 1, then four.
std::size_t npy_literal_start(std::string_view text) {
    return text[kNpyMagic] == 1 ? kNpyFirst - 2 : kNpyFirst;
}

}  // namespace

std::uint64_t npy_header_bytes(std::string_view text) {
    if (text.size() < kNpyFirst) {
        return kNpyFirst;
    }
    const std::size_t start = npy_literal_start(text);
    return start + (start < kNpyFirst ? number_at<std::uint16_t>(text, 8, false)
                                      : std::uint64_t{number_at<std::uint32_t>(text, 8, false)});
}

NpyHeader parse_npy_header(std::string_view text, const std::string& name) {
    if (text.size() < kNpyFirst || text.substr(0, kNpyMagic) != "\x93NUMPY") {
        throw Error(ErrorKind::corrupt, {name}, "not an array of NumPy");
    }
    const int version = static_cast<unsigned char>(text[kNpyMagic]);
    if (version < 1 || version > 3) {
        throw Error(ErrorKind::unsupported, {name, "npy header"},
                    fmt::format("version {}: 1 to 3 are read", version));
    }
    const std::uint64_t bytes = npy_header_bytes(text);
    const std::size_t start = npy_literal_start(text);
    if (bytes > text.size()) {
        throw Error(ErrorKind::corrupt, {name, "npy header"},
                    fmt::format("{} bytes: the file ends before, or it is longer than the {} that "
                                "are read",
                                bytes - start, kMostNpyHeader));
    }
    NpyHeader header =
        Literal(text.substr(start, static_cast<std::size_t>(bytes) - start), name).parse();
    header.bytes = bytes;
    return header;
}

}  // namespace isonest::detail
