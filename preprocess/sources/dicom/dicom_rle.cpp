#include "preprocess/sources/dicom/dicom_rle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "preprocess/sources/bytes/header_number.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kHeader = 64;

/// Writes `count` bytes, `step` apart; false if the segment has fewer.
bool unpack_segment(std::string_view segment, std::size_t count, std::size_t step, std::byte* dst) {
    std::size_t done = 0;
    std::size_t at = 0;
    while (done < count) {
        if (at >= segment.size()) {
            return false;
        }
        const auto control = static_cast<std::int8_t>(segment[at++]);
        if (control >= 0) {  // so many bytes and one more as they are
            const auto literal = static_cast<std::size_t>(control) + 1;
            if (literal > segment.size() - at) {
                return false;
            }
            for (std::size_t i = 0; i < std::min(literal, count - done); ++i) {
                dst[(done + i) * step] = static_cast<std::byte>(segment[at + i]);
            }
            at += literal;
            done += literal;
        } else if (control != INT8_MIN) {  // the next byte, 1 - control times
            if (at >= segment.size()) {
                return false;
            }
            const auto repeated = static_cast<std::size_t>(1 - control);
            for (std::size_t i = 0; i < std::min(repeated, count - done); ++i) {
                dst[(done + i) * step] = static_cast<std::byte>(segment[at]);
            }
            ++at;
            done += repeated;
        }
    }
    return true;
}

}  // namespace

std::string unpack_dicom_rle(std::span<const char> frame, std::size_t size,
                             std::span<std::byte> dst) {
    const std::string_view text(frame.data(), frame.size());
    if (text.size() < kHeader) {
        return "the frame ends inside of its list of segments";
    }
    const auto segments = number_at<std::uint32_t>(text, 0, false);
    if (segments != size) {
        return fmt::format("there are {} segments, numbers have {} bytes", segments, size);
    }
    for (std::size_t s = 0; s < size; ++s) {
        const std::size_t begin = number_at<std::uint32_t>(text, 4 + 4 * s, false);
        const std::size_t end =
            s + 1 < size ? number_at<std::uint32_t>(text, 8 + 4 * s, false) : text.size();
        if (begin < kHeader || begin > end || end > text.size()) {
            return fmt::format("segment {} lies at bytes {} to {} of {}", s, begin, end,
                               text.size());
        }
        // The most significant byte comes first.
        if (!unpack_segment(text.substr(begin, end - begin), dst.size() / size, size,
                            dst.data() + size - 1 - s)) {
            return fmt::format("segment {} ends too early", s);
        }
    }
    return {};
}

}  // namespace isonest::detail
