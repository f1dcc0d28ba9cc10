#include "preprocess/sources/dicom/dicom_elements.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kPreamble = 128;
constexpr std::uint64_t kWindow = 16384;
constexpr std::uint64_t kMaxText = 65536;
constexpr std::uint64_t kMaxBytes = 1U << 20U;
constexpr int kMaxDepth = 16;
constexpr DicomTag kItem = 0xFFFEE000;
constexpr DicomTag kItemEnd = 0xFFFEE00D;
constexpr DicomTag kSequenceEnd = 0xFFFEE0DD;
constexpr std::uint32_t kUndefined = 0xFFFFFFFF;

bool is_long(std::string_view vr) {
    constexpr std::array<std::string_view, 14> kLong{"OB", "OD", "OF", "OL", "OV", "OW", "SQ",
                                                     "SV", "UC", "UN", "UR", "UT", "UV", "??"};
    return std::find(kLong.begin(), kLong.end(), vr) != kLong.end();
}

bool is_pixels(DicomTag tag) {
    return tag == kPixelData || tag == kFloatPixelData || tag == kDoublePixelData;
}

DicomSyntax syntax_of(const std::string& uid) {
    if (uid == "1.2.840.10008.1.2") {
        return {uid, false, false, true};
    }
    if (uid == "1.2.840.10008.1.2.1") {
        return {uid, true, false, true};
    }
    if (uid == "1.2.840.10008.1.2.2") {
        return {uid, true, true, true};
    }
    if (uid == "1.2.840.10008.1.2.1.99") {
        return {uid, true, false, true, true};
    }
    return {uid, true, false, false};
}

/// A reader of bytes in memory.
class InflatedStart : public ByteReader {
  public:
    explicit InflatedStart(std::string bytes) : bytes_(std::move(bytes)) {}
    [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
    void read(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        std::memcpy(dst, bytes_.data() + at, bytes);
    }

  private:
    std::string bytes_;
};

/// Decompresses the start of a raw deflate stream, up to kMaxBytes.
std::string first_inflated(std::string packed) {
    constexpr int kWithoutHead = -15;
    std::string result(kMaxBytes, '\0');
    z_stream stream{};
    if (inflateInit2(&stream, kWithoutHead) != Z_OK) {
        return {};
    }
    stream.next_in = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_in = static_cast<uInt>(packed.size());
    stream.next_out = reinterpret_cast<Bytef*>(result.data());
    stream.avail_out = static_cast<uInt>(result.size());
    inflate(&stream, Z_SYNC_FLUSH);
    result.resize(result.size() - stream.avail_out);
    inflateEnd(&stream);
    return result;
}

std::string without_padding(const std::string& text) {
    const std::size_t last = text.find_last_not_of(std::string_view(" \0", 2));
    const std::size_t first = text.find_first_not_of(' ');
    return last == std::string::npos ? std::string{} : text.substr(first, last + 1 - first);
}

bool has_preamble(std::string_view head) {
    return head.size() >= kPreamble + 4 && head.substr(kPreamble, 4) == "DICM";
}

/// The start of a file without preamble.
struct BareStart {
    bool own_group = false;  ///< begins with the file meta group
    bool explicit_vr = true;
    bool big_endian = false;
    std::string class_uid = {};
};

/// The SOP class in a sequence of elements with increasing tags that begins at the first byte;
/// empty if there is none that DICOM defines.
std::string bare_class(std::string_view head, bool explicit_vr, bool big_endian) {
    constexpr std::string_view kDefined = "1.2.840.10008.";
    DicomTag last = 0;
    for (std::size_t at = 0; at + 12 <= head.size();) {
        const auto tag = static_cast<DicomTag>(number_at<std::uint16_t>(head, at, big_endian))
                             << 16U |
                         number_at<std::uint16_t>(head, at + 2, big_endian);
        if ((tag >> 16U != 2 && tag >> 16U != 8) || (at > 0 && tag <= last)) {
            return {};
        }
        std::uint64_t length = 0;
        std::size_t value = at + 8;
        if (!explicit_vr) {
            length = number_at<std::uint32_t>(head, at + 4, big_endian);
        } else {
            const std::string_view vr = head.substr(at + 4, 2);
            if (vr[0] < 'A' || vr[0] > 'Z' || vr[1] < 'A' || vr[1] > 'Z') {
                return {};
            }
            length = number_at<std::uint16_t>(head, at + 6, big_endian);
            if (is_long(vr)) {
                length = number_at<std::uint32_t>(head, at + 8, big_endian);
                value += 4;
            }
        }
        if (length % 2 != 0 || value + length > head.size()) {
            return {};
        }
        if (tag == 0x00020002 || tag == 0x00080016) {
            const std::string uid = without_padding(std::string(head.substr(value, length)));
            return uid.starts_with(kDefined) ? uid : std::string{};
        }
        last = tag;
        at = value + length;
    }
    return {};
}

std::optional<BareStart> bare_start(std::string_view head) {
    if (head.size() < 2) {
        return std::nullopt;
    }
    const std::string_view group = head.substr(0, 2);
    if (group == std::string_view("\2\0", 2)) {
        const std::string uid = bare_class(head, true, false);
        return uid.empty() ? std::nullopt : std::optional(BareStart{true, true, false, uid});
    }
    const bool little = group == std::string_view("\10\0", 2);
    const bool big = group == std::string_view("\0\10", 2);
    for (const bool explicit_vr : {true, false}) {
        if (little || (big && explicit_vr)) {
            const std::string uid = bare_class(head, explicit_vr, big);
            if (!uid.empty()) {
                return BareStart{false, explicit_vr, big, uid};
            }
        }
    }
    return std::nullopt;
}

}  // namespace

bool starts_as_dicom(std::string_view head) {
    return has_preamble(head) || bare_start(head).has_value();
}

bool is_dicom_file(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    std::string head(kDicomHead, '\0');
    file.read(head.data(), static_cast<std::streamsize>(head.size()));
    head.resize(static_cast<std::size_t>(file.gcount()));
    return starts_as_dicom(head);
}

bool same_dicom_object(const std::filesystem::path& a, const std::filesystem::path& b) {
    DicomFile first(a);
    DicomFile second(b);
    const std::uint64_t count = first.size() - first.start();
    if (first.syntax().uid != second.syntax().uid || second.size() - second.start() != count) {
        return false;
    }
    std::vector<std::byte> one(std::min(count, kMaxBytes));
    std::vector<std::byte> other(one.size());
    for (std::uint64_t at = 0; at < count; at += one.size()) {
        const std::uint64_t part = std::min<std::uint64_t>(one.size(), count - at);
        first.read(first.start() + at, one.data(), part);
        second.read(second.start() + at, other.data(), part);
        if (std::memcmp(one.data(), other.data(), part) != 0) {
            return false;
        }
    }
    return true;
}

bool was_dicom_file(const std::filesystem::path& path) {
    const std::string ending = lower(path.extension().string());
    if (ending == ".dcm" || ending == ".dicom" || ending == ".ima") {
        return true;
    }
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (error || size == 0 || size >= kPreamble + 4) {
        return false;
    }
    std::ifstream file(path, std::ios::binary);
    std::string head(size, '\1');
    file.read(head.data(), static_cast<std::streamsize>(size));
    return head.substr(0, kPreamble).find_first_not_of('\0') == std::string::npos;
}

DicomFile::DicomFile(const std::filesystem::path& path)
    : name_(path.string()), reader_(file_bytes(path, 0, regular_file_size(path))) {
    begin();
}

void DicomFile::fail(std::uint64_t at, const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {name_, fmt::format("byte {}", at)}, problem,
                {{RemedyKind::good_copy}});
}

void DicomFile::read(std::uint64_t at, std::byte* dst, std::uint64_t count) {
    if (at > size() || count > size() - at) {
        fail(at,
             fmt::format("{} bytes should follow, but the file ends at byte {}", count, size()));
    }
    reader_->read(at, dst, count);
}

std::string DicomFile::bytes(std::uint64_t at, std::uint64_t count) {
    if (at < window_at_ || at + count > window_at_ + window_.size()) {
        if (at > size() || count > size() - at) {
            fail(at, fmt::format("{} bytes should follow, but the file ends at byte {}", count,
                                 size()));
        }
        std::string window(std::min(std::max(count, kWindow), size() - at), '\0');
        reader_->read(at, reinterpret_cast<std::byte*>(window.data()), window.size());
        window_ = std::move(window);
        window_at_ = at;
    }
    return window_.substr(at - window_at_, count);
}

DicomElement DicomFile::element(std::uint64_t at, std::uint64_t end, const Coding& coding) {
    const auto need = [&](std::uint64_t count) {
        if (at + count > end) {
            fail(at, "the file ends inside an element");
        }
    };
    need(8);
    const std::string head = bytes(at, 8);
    DicomElement result;
    result.tag = static_cast<DicomTag>(number_at<std::uint16_t>(head, 0, coding.big_endian)) << 16U;
    result.tag |= number_at<std::uint16_t>(head, 2, coding.big_endian);
    std::uint32_t length = 0;
    if (!coding.explicit_vr || result.tag >> 16U == kItem >> 16U) {
        length = number_at<std::uint32_t>(head, 4, coding.big_endian);
        result.at = at + 8;
    } else {
        result.vr = head.substr(4, 2);
        if (is_long(result.vr)) {
            need(12);
            length = number_at<std::uint32_t>(bytes(at + 8, 4), 0, coding.big_endian);
            result.at = at + 12;
        } else {
            length = number_at<std::uint16_t>(head, 6, coding.big_endian);
            result.at = at + 8;
        }
    }
    result.undefined = length == kUndefined;
    result.length = result.undefined ? 0 : length;
    if (result.at + result.length > end) {
        fail(at, fmt::format("the element ({:04x},{:04x}) has {} bytes, but only {} follow",
                             result.tag >> 16U, result.tag & 0xFFFFU, result.length,
                             end - std::min(end, result.at)));
    }
    return result;
}

/// Visits the elements from `at`; returns the position after them.
std::uint64_t DicomFile::set(std::uint64_t at, std::uint64_t end, bool delimited,
                             const Coding& coding, int depth) {
    while (delimited || at < end) {
        const DicomElement e = element(at, end, coding);
        if (delimited && e.tag == kItemEnd) {
            return e.at;
        }
        if (depth == 0 && is_pixels(e.tag)) {
            pixels_ = e;
            return end;
        }
        // With implicit VR, sequences of known length look like other values: the visitor knows
        // which tags it expects to be sequences.
        const bool sequential = e.vr == "SQ" || e.undefined ||
                                (e.vr.empty() && visitor_ != nullptr && visitor_->enter(e.tag, -1));
        if (sequential) {
            // UN with undefined length is encoded with implicit VR (PS3.5, 6.2.2).
            at = sequence(e, end, e.vr == "UN" ? Coding{false, false} : coding, depth + 1);
        } else {
            if (visitor_ != nullptr) {
                visitor_->value(e);
            }
            at = e.at + e.length;
        }
    }
    return at;
}

std::uint64_t DicomFile::sequence(const DicomElement& of, std::uint64_t end, const Coding& coding,
                                  int depth) {
    if (depth > kMaxDepth) {
        fail(of.at, fmt::format("sequences are nested more than {} levels deep", kMaxDepth));
    }
    const Visitor* const visitor = visitor_;
    if (!of.undefined && (visitor == nullptr || !visitor->enter(of.tag, -1))) {
        return of.at + of.length;
    }
    const std::uint64_t stop = of.undefined ? end : of.at + of.length;
    std::uint64_t at = of.at;
    std::int64_t number = 0;
    while (of.undefined || at < stop) {
        const DicomElement item = element(at, stop, coding);
        if (of.undefined && item.tag == kSequenceEnd) {
            return item.at;
        }
        if (item.tag != kItem) {
            fail(at, "a sequence contains something other than items");
        }
        const bool enters = visitor != nullptr && visitor->enter(of.tag, number++);
        if (!enters && !item.undefined) {
            at = item.at + item.length;
            continue;
        }
        visitor_ = enters ? visitor : nullptr;
        at = set(item.at, item.undefined ? stop : item.at + item.length, item.undefined, coding,
                 depth);
        visitor_ = visitor;
        if (enters) {
            visitor->leave(of.tag);
        }
    }
    return at;
}

void DicomFile::begin() {
    const std::string head = bytes(0, std::min<std::uint64_t>(size(), kDicomHead));
    if (has_preamble(head)) {
        read_own_group(kPreamble + 4);
        return;
    }
    const std::optional<BareStart> bare = bare_start(head);
    if (!bare) {
        throw Error(
            ErrorKind::corrupt, {name_},
            "there is no DICM after the first 128 bytes; the file is damaged, or it is not a "
            "DICOM file and should be left out",
            {{RemedyKind::good_copy}});
    }
    if (bare->own_group) {
        read_own_group(0);
        return;
    }
    class_uid_ = bare->class_uid;
    syntax_ = syntax_of(!bare->explicit_vr ? "1.2.840.10008.1.2"
                        : bare->big_endian ? "1.2.840.10008.1.2.2"
                                           : "1.2.840.10008.1.2.1");
}

void DicomFile::read_own_group(std::uint64_t at) {
    std::string uid;
    while (at + 8 <= size()) {
        if (number_at<std::uint16_t>(bytes(at, 2), 0, false) != 2) {
            break;
        }
        const DicomElement e = element(at, size(), {true, false});
        if (e.undefined) {
            fail(at, "an element of the file meta information has no length");
        }
        if (e.tag == 0x00020002) {
            class_uid_ = text(e);
        } else if (e.tag == 0x00020010) {
            uid = text(e);
        }
        at = e.at + e.length;
    }
    if (uid.empty()) {
        fail(at, "the transfer syntax (0002,0010) is missing");
    }
    start_ = at;
    syntax_ = syntax_of(uid);
    if (syntax_.deflated) {
        reader_ = std::make_unique<InflatedStart>(
            first_inflated(bytes(at, std::min(size() - at, kMaxBytes))));
        window_.clear();
        window_at_ = start_ = 0;
    }
}

DicomElement DicomFile::visit(const Visitor& visitor) {
    visitor_ = &visitor;
    pixels_ = {};
    set(start_, size(), false, {syntax_.explicit_vr, syntax_.big_endian}, 0);
    visitor_ = nullptr;
    return pixels_;
}

std::string DicomFile::text(const DicomElement& element) {
    return without_padding(bytes(element.at, std::min(element.length, kMaxText)));
}

void DicomFile::refuse_number(const DicomElement& element, const std::string& text) const {
    throw Error(ErrorKind::corrupt,
                {name_, fmt::format("({:04x},{:04x})", element.tag >> 16U, element.tag & 0xFFFFU)},
                fmt::format("\"{}\" is not a number", text), {{RemedyKind::good_copy}});
}

double DicomFile::decimal(const DicomElement& element, const std::string& text) const {
    const char* const end = text.data() + text.size();
    const bool has_plus = text.front() == '+' && !text.starts_with("+-");
    const char* const begin = text.data() + (has_plus ? 1 : 0);
    double value = 0;
    const auto [stop, error] = std::from_chars(begin, end, value);
    if (error != std::errc{} || stop != end || !std::isfinite(value)) {
        refuse_number(element, text);
    }
    return value;
}

std::vector<double> DicomFile::numbers(const DicomElement& element) {
    std::vector<double> result;
    const std::uint64_t length = std::min(element.length, kMaxBytes);
    const std::string all = bytes(element.at, length);
    const bool big = syntax_.big_endian;
    const auto binary = [&](auto zero) {
        using T = decltype(zero);
        for (std::size_t at = 0; at + sizeof(T) <= all.size(); at += sizeof(T)) {
            const auto value = static_cast<double>(number_at<T>(all, at, big));
            if (!std::isfinite(value)) {
                refuse_number(element, fmt::format("{}", value));
            }
            result.push_back(value);
        }
    };
    // With implicit VR, all requested values are text except FD.
    if (element.vr == "FD") {
        binary(double{});
    } else if (element.vr == "FL") {
        binary(float{});
    } else if (element.vr == "US") {
        binary(std::uint16_t{});
    } else if (element.vr == "SS") {
        binary(std::int16_t{});
    } else if (element.vr == "UL") {
        binary(std::uint32_t{});
    } else if (element.vr == "SL") {
        binary(std::int32_t{});
    } else {
        for (std::size_t at = 0; at < all.size();) {
            const std::size_t end = std::min(all.find('\\', at), all.size());
            const std::string value = without_padding(all.substr(at, end - at));
            if (!value.empty()) {
                result.push_back(decimal(element, value));
            }
            at = end + 1;
        }
    }
    return result;
}

std::uint16_t DicomFile::whole(const DicomElement& element) {
    return element.length < 2
               ? std::uint16_t{0}
               : number_at<std::uint16_t>(bytes(element.at, 2), 0, syntax_.big_endian);
}

std::vector<DicomElement> DicomFile::fragments(const DicomElement& pixels, std::size_t most) {
    std::vector<DicomElement> result;
    std::uint64_t at = pixels.at;
    while (true) {
        const DicomElement item = element(at, size(), {true, false});
        if (item.tag == kSequenceEnd) {
            return result;
        }
        if (item.tag != kItem || item.undefined) {
            fail(at, "the pixel data contain something other than fragments");
        }
        if (result.size() > most) {
            throw Error(
                ErrorKind::unsupported, {name_},
                fmt::format("the pixel data have more than {} fragments, which is the limit",
                            most));
        }
        result.push_back(item);
        at = item.at + item.length;
    }
}

namespace {

/// Maximum of tags, and of items per tag; nibabel's limit.
constexpr std::uint32_t kMaxOfEach = 1000;
constexpr std::size_t kTagBytes = 84;
constexpr std::size_t kItemBytes = 16;

/// Reads bytes in order; returns false if there are too few.
class CsaReader {
  public:
    explicit CsaReader(std::string_view bytes) : bytes_(bytes) {}
    bool skip(std::size_t count) {
        if (count > bytes_.size() - at_) {
            return false;
        }
        at_ += count;
        return true;
    }
    /// The next `count` bytes; none if there are fewer.
    std::optional<std::string_view> take(std::size_t count) {
        const std::size_t from = at_;
        return skip(count) ? std::optional(bytes_.substr(from, count)) : std::nullopt;
    }

  private:
    std::string_view bytes_;
    std::size_t at_ = 0;
};

std::string_view until_zero(std::string_view text) {
    return text.substr(0, text.find('\0'));
}

std::optional<double> number_of(std::string_view text) {
    const std::string plain = trimmed(std::string(text));
    double value = 0;
    const auto [end, error] = std::from_chars(plain.data(), plain.data() + plain.size(), value);
    return error == std::errc{} && end == plain.data() + plain.size() && std::isfinite(value)
               ? std::optional(value)
               : std::nullopt;
}

/// The non-empty items of a tag. `first_items`: the number of items of the first tag, by which
/// lengths are too large in the older format (CSA1). False if there are too few bytes.
bool read_items(CsaReader& reader, std::int32_t count, bool newer, std::int32_t first_items,
                std::vector<std::string_view>& items) {
    for (std::int32_t i = 0; i < count; ++i) {
        const auto head = reader.take(kItemBytes);
        if (!head) {
            return false;
        }
        const std::int64_t length =
            newer ? number_at<std::int32_t>(*head, 4, false)
                  : std::int64_t{number_at<std::int32_t>(*head, 0, false)} - first_items;
        const auto value =
            length < 0 ? std::nullopt : reader.take(static_cast<std::size_t>(length));
        if (!value) {
            return !newer;
        }
        reader.skip(static_cast<std::size_t>((4 - length % 4) % 4));
        if (!until_zero(*value).empty()) {
            items.push_back(until_zero(*value));
        }
    }
    return true;
}

}  // namespace

std::optional<SiemensMosaic> mosaic_of_csa(std::string_view csa) {
    CsaReader reader(csa);
    const bool newer = csa.starts_with("SV10");
    if (newer) {
        reader.skip(8);
    }
    const auto head = reader.take(8);
    const std::uint32_t tags = head ? number_at<std::uint32_t>(*head, 0, false) : 0;
    if (tags == 0 || tags > kMaxOfEach) {
        return std::nullopt;
    }
    SiemensMosaic mosaic;
    std::int32_t first_items = 0;
    for (std::uint32_t tag = 0; tag < tags; ++tag) {
        const auto about = reader.take(kTagBytes);
        if (!about) {
            return std::nullopt;
        }
        const std::string_view name = until_zero(about->substr(0, 64));
        const auto count = number_at<std::int32_t>(*about, 76, false);
        first_items = tag == 0 ? count : first_items;
        std::vector<std::string_view> items;
        if (count < 0 || count > static_cast<std::int32_t>(kMaxOfEach) ||
            !read_items(reader, count, newer, first_items, items)) {
            return std::nullopt;
        }
        if (name == "NumberOfImagesInMosaic" && !items.empty()) {
            const std::optional<double> images = number_of(items[0]);
            mosaic.images =
                images && std::fabs(*images) < 1e6 ? static_cast<std::int64_t>(*images) : 0;
        } else if (name == "SliceNormalVector" && items.size() == 3) {
            const auto x = number_of(items[0]);
            const auto y = number_of(items[1]);
            const auto z = number_of(items[2]);
            if (x && y && z) {
                mosaic.normal = Double3{*x, *y, *z};
            }
        }
    }
    return mosaic.images > 0 ? std::optional(mosaic) : std::nullopt;
}

}  // namespace isonest::detail
