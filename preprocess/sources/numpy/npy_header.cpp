// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
#include "preprocess/sources/numpy/npy_header.h"

#include <fmt/format.h>

#include <charconv>
#include <map>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_number.h"

namespace isonest::detail {
namespace {

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
                header.fortran = word() == "True";
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
        while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n')) {
            ++at_;
        }
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
        expect('\'');
        const std::size_t end = text_.find('\'', at_);
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
        return text_.substr(from, at_ - from);
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
            const std::string_view number = word();
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

}  // namespace

NpyHeader parse_npy_header(std::string_view text, const std::string& name) {
    constexpr std::size_t kMagic = 6;
    constexpr std::size_t kShort = 10;
    constexpr std::size_t kLong = 12;
    if (text.size() < kLong || text.substr(0, kMagic) != "\x93NUMPY") {
        throw Error(ErrorKind::corrupt, {name}, "not an array of NumPy");
    }
    const int version = static_cast<unsigned char>(text[kMagic]);
    if (version < 1 || version > 3) {
        throw Error(ErrorKind::unsupported, {name, "npy header"},
                    fmt::format("version {}: 1 to 3 are read", version));
    }
    const std::size_t start = version == 1 ? kShort : kLong;
    const std::uint64_t length = version == 1 ? number_at<std::uint16_t>(text, 8, false)
                                              : number_at<std::uint32_t>(text, 8, false);
    if (length > text.size() - start) {
        throw Error(ErrorKind::corrupt, {name, "npy header"},
                    fmt::format("{} bytes: the file ends before, or it is longer than the {} that "
                                "are read",
                                length, kMostNpyHeader));
    }
    NpyHeader header = Literal(text.substr(start, static_cast<std::size_t>(length)), name).parse();
    header.bytes = start + length;
    return header;
}

}  // namespace isonest::detail
