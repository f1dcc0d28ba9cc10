#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/packed_block.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/placement/placed_array.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

// The header of NumPy .npy files.

struct NpyHeader {
    ValueType type = ValueType::u8;
    std::optional<StoredNumber> stored;  ///< instead of the type
    bool big_endian = false;
    bool fortran = false;  ///< the first axis is the fastest
    std::vector<std::int64_t> shape;
    std::uint64_t bytes = 0;  ///< of the header; the numbers follow
};

/// Maximum size of a header.
inline constexpr std::size_t kMaxNpyHeader = std::size_t{1} << 16U;

/// Size of the header, from the first byte of the file, given the first 12 bytes in `text`. No I/O.
std::uint64_t npy_header_bytes(std::string_view text);

/// Parses the start of a file. Throws Error{corrupt, unsupported}. No I/O.
NpyHeader parse_npy_header(std::string_view text, const std::string& name);

// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html

namespace {

constexpr std::size_t kNpyMagic = 6;
constexpr std::size_t kNpyFirst = 12;  ///< maximum number of bytes before the literal
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
                    corrupt(fmt::format("'fortran_order' is '{:.40}', but must be True or False",
                                        truth));
                }
                header.fortran = truth == "True";
            } else if (key == "shape") {
                set_shape(header);
                has_shape_ = true;
            } else {
                corrupt(fmt::format("unknown key '{:.40}'", key));
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
            corrupt(fmt::format("expected '{}' at byte {}", c, at_));
        }
    }
    std::string quoted() {
        skip_blanks();
        const char mark = at_ < text_.size() && text_[at_] == '"' ? '"' : '\'';
        expect(mark);
        const std::size_t end = text_.find(mark, at_);
        if (end == std::string_view::npos) {
            corrupt("a string has no closing quote");
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
            throw Error(
                ErrorKind::unsupported, {name_, "npy header"},
                "the array has records of several fields; save only the field that is the volume");
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
                        fmt::format("the type '{:.40}' is not supported; save integers or floating "
                                    "point numbers of up to 64 bits",
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
        constexpr std::size_t kMaxAxes = 64;
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
                header.shape.size() >= kMaxAxes) {
                corrupt(fmt::format("invalid axis length '{:.40}', or too many axes", number));
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

/// After the literal's length, which has two bytes in version 1, four later.
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
        throw Error(ErrorKind::corrupt, {name}, "not a NumPy array");
    }
    const int version = static_cast<unsigned char>(text[kNpyMagic]);
    if (version < 1 || version > 3) {
        throw Error(ErrorKind::unsupported, {name, "npy header"},
                    fmt::format("version {} is not supported; versions 1 to 3 are", version));
    }
    const std::uint64_t bytes = npy_header_bytes(text);
    const std::size_t start = npy_literal_start(text);
    if (bytes > text.size()) {
        throw Error(
            ErrorKind::corrupt, {name, "npy header"},
            fmt::format("the header of {} bytes is cut short, or longer than the limit of {}",
                        bytes - start, kMaxNpyHeader));
    }
    NpyHeader header =
        Literal(text.substr(start, static_cast<std::size_t>(bytes) - start), name).parse();
    header.bytes = bytes;
    return header;
}

namespace {

std::unique_ptr<VolumeSource> open_array(const NpyHeader& header, PlacedArray array,
                                         const SourceOptions& options) {
    for (const std::int64_t length : header.shape) {
        array.axes.push_back({"", length, true});
    }
    if (header.fortran) {
        std::uint64_t stride = 1;
        for (const std::int64_t length : header.shape) {
            array.strides.push_back(stride);
            // place_in_array() refuses arrays that are too large.
            stride *= static_cast<std::uint64_t>(length);
        }
    }
    array.layout.type = header.type;
    array.stored = header.stored;
    array.layout.big_endian = header.big_endian;
    return without_spacing(open_placed(array, options.index), options);
}

bool is_npy(const VolumeInput& input) {
    return !input.folder && input.unpacked.starts_with("\x93NUMPY");
}

/// Only the first bytes of a compressed file are available; a long header needs more.
std::string unpacked_header(const VolumeInput& input) {
    if (npy_header_bytes(input.unpacked) <= input.unpacked.size()) {
        return input.unpacked;
    }
    std::string text(kMaxNpyHeader, '\0');
    GzipStream stream(input.file, input.name(), 0, DeflateWrapper::gzip);
    text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    return text;
}

std::unique_ptr<VolumeSource> open_npy(const VolumeInput& input, const SourceOptions& options) {
    PlacedArray array;
    array.file = input.file;
    array.name = input.name();
    const NpyHeader header = parse_npy_header(
        input.gzip() ? unpacked_header(input) : first_bytes(input.file, kMaxNpyHeader), array.name);
    array.layout.offset = header.bytes;
    array.layout.packing = input.gzip() ? Packing::gzip : Packing::plain;
    return open_array(header, std::move(array), options);
}

constexpr std::string_view kEnding = ".npy";

std::string array_name(const ZipMember& member) {
    return member.name.ends_with(kEnding)
               ? member.name.substr(0, member.name.size() - kEnding.size())
               : member.name;
}

/// Whether this is an archive whose first member is an array.
bool is_npz(const VolumeInput& input) {
    constexpr std::size_t kName = 30;
    if (input.folder || !input.head.starts_with("PK\3\4") || input.head.size() < kName) {
        return false;
    }
    const std::size_t length = static_cast<unsigned char>(input.head[26]) +
                               256 * std::size_t{static_cast<unsigned char>(input.head[27])};
    return std::string_view(input.head).substr(kName, length).ends_with(kEnding);
}

std::string start_of(const std::filesystem::path& path, const ZipMember& member) {
    if (!member.deflated) {
        return first_bytes(
            path, static_cast<std::size_t>(std::min<std::uint64_t>(member.packed, kMaxNpyHeader)),
            member.start);
    }
    std::string text(kMaxNpyHeader, '\0');
    GzipStream stream(path, path.string(), member.start, DeflateWrapper::none);
    text.resize(stream.read(reinterpret_cast<std::byte*>(text.data()), text.size()));
    return text;
}

std::unique_ptr<VolumeSource> open_npz(const VolumeInput& input, const SourceOptions& options) {
    const std::filesystem::path& path = input.path();
    const std::vector<ZipMember> members = read_zip_directory(path);
    const ZipMember* chosen = nullptr;
    std::string list;
    std::size_t arrays = 0;
    constexpr std::size_t kMaxListed = 40;
    for (const ZipMember& member : members) {
        if (!member.name.ends_with(kEnding)) {
            continue;
        }
        if (!options.dataset.empty()) {
            chosen = array_name(member) == options.dataset ? &member : chosen;
        } else if (arrays == 0) {
            chosen = &member;
        }
        if (arrays++ < kMaxListed) {
            list += fmt::format("\n  {}", array_name(member));
        }
    }
    if (chosen == nullptr) {
        throw Error(ErrorKind::not_found, {path.string()},
                    options.dataset.empty() ? std::string("there is no array in the file")
                                            : fmt::format("there is no array '{}'; the file has:{}",
                                                          options.dataset, list));
    }
    if (options.dataset.empty() && arrays > 1) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "the file has several arrays:" + list, {{RemedyKind::choose_dataset}});
    }
    PlacedArray array;
    array.file = path;
    array.name = path.string() + ":" + array_name(*chosen);
    if (!chosen->readable) {
        throw Error(ErrorKind::unsupported, {array.name},
                    "it is encrypted, or compressed by a method other than deflate");
    }
    const NpyHeader header = parse_npy_header(start_of(path, *chosen), array.name);
    array.layout.start = chosen->start;
    array.layout.offset = header.bytes;
    array.layout.packing = chosen->deflated ? Packing::deflate : Packing::plain;
    array.layout.exact_length = chosen->deflated;
    return open_array(header, std::move(array), options);
}

}  // namespace

VolumeFormat npy_format() {
    return {.about = {"NumPy", ".npy", ""},
            .takes = {.index = true},
            .reads_urls = true,
            .recognises = is_npy,
            .open = open_npy};
}

VolumeFormat npz_format() {
    return {.about = {"NumPy archive", ".npz", ""},
            .takes = {.dataset = true, .index = true},
            .recognises = is_npz,
            .open = open_npz};
}

}  // namespace isonest::detail
