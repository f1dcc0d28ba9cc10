#include "preprocess/sources/dicom/module/codestream_size.h"

#include <string_view>

#include "preprocess/sources/bytes/header_number.h"

namespace isonest::detail {
namespace {

std::string_view text(std::span<const char> stream) {
    return {stream.data(), stream.size()};
}

std::optional<CodestreamSize> jpeg2000_size(std::string_view s) {
    constexpr std::size_t kSiz = 2;  // after SOC
    if (s.size() < kSiz + 41 || number_at<std::uint16_t>(s, kSiz, true) != 0xFF51) {
        return std::nullopt;
    }
    const auto at = [&](std::size_t offset) {
        return static_cast<std::int64_t>(number_at<std::uint32_t>(s, kSiz + offset, true));
    };
    CodestreamSize size;
    size.columns = at(6) - at(14);
    size.rows = at(10) - at(18);
    size.components = number_at<std::uint16_t>(s, kSiz + 38, true);
    size.bits = (static_cast<unsigned char>(s[kSiz + 40]) & 0x7F) + 1;
    return size;
}

bool is_frame_header(unsigned marker) {
    constexpr unsigned kHuffmanTable = 0xFFC4;
    constexpr unsigned kReserved = 0xFFC8;
    constexpr unsigned kArithmetic = 0xFFCC;
    constexpr unsigned kJpegLs = 0xFFF7;
    return marker == kJpegLs || (marker >= 0xFFC0 && marker <= 0xFFCF && marker != kHuffmanTable &&
                                 marker != kReserved && marker != kArithmetic);
}

std::optional<CodestreamSize> jpeg_size(std::string_view s) {
    std::size_t at = 2;  // after SOI
    while (at + 10 <= s.size()) {
        const unsigned marker = number_at<std::uint16_t>(s, at, true);
        if (marker == 0xFFFF) {  // a byte to fill up
            ++at;
            continue;
        }
        const std::size_t length = number_at<std::uint16_t>(s, at + 2, true);
        if (marker >> 8U != 0xFF || length < 2) {
            return std::nullopt;
        }
        if (is_frame_header(marker)) {
            CodestreamSize size;
            size.bits = static_cast<unsigned char>(s[at + 4]);
            size.rows = number_at<std::uint16_t>(s, at + 5, true);
            size.columns = number_at<std::uint16_t>(s, at + 7, true);
            size.components = static_cast<unsigned char>(s[at + 9]);
            return size;
        }
        at += 2 + length;
    }
    return std::nullopt;
}

}  // namespace

bool is_jpeg2000(std::span<const char> stream) {
    return text(stream).starts_with("\xFF\x4F");
}

std::optional<CodestreamSize> codestream_size(std::span<const char> stream) {
    if (is_jpeg2000(stream)) {
        return jpeg2000_size(text(stream));
    }
    return text(stream).starts_with("\xFF\xD8") ? jpeg_size(text(stream)) : std::nullopt;
}

}  // namespace isonest::detail
