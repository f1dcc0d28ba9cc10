#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/slices/slice_picture.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

struct Bmp {
    std::int64_t width = 0;
    std::int64_t height = 0;
    bool upside_down = true;      ///< the row at the bottom comes first
    int bits = 0;                 ///< of a pixel
    std::uint64_t start = 0;      ///< of the rows
    std::uint64_t row = 0;        ///< bytes
    std::array<int, 256> grey{};  ///< of the palette's colours; -1 for numbers that it has not
};

Bmp read_bmp_header(const std::filesystem::path& file) {
    constexpr std::size_t kMost = 14 + 124 + 12 + 1024;
    constexpr std::size_t kLeast = 14 + 40;
    const std::string head = first_bytes(file, kMost);
    const auto corrupt = [&](const std::string& what) {
        throw Error(ErrorKind::corrupt, {file.string(), "BMP header"}, what);
    };
    const auto unsupported = [&](const std::string& what) {
        throw Error(ErrorKind::unsupported, {file.string(), "BMP header"},
                    what +
                        ": write it as grey values of 8 bits, for example with: convert IN.bmp "
                        "-colorspace Gray OUT.png");
    };
    if (!head.starts_with("BM") || head.size() < kLeast) {
        corrupt("it is no BMP file, or cut short");
    }
    const auto word = [&](std::size_t at) { return number_at<std::uint32_t>(head, at, false); };
    const std::uint32_t header = word(14);
    constexpr std::array<std::uint32_t, 5> kHeaders{40, 52, 56, 108, 124};
    if (std::find(kHeaders.begin(), kHeaders.end(), header) == kHeaders.end()) {
        unsupported(fmt::format("a header of {} bytes", header));
    }
    if (head.size() < 14 + header) {
        corrupt("it is cut short");
    }
    Bmp bmp;
    bmp.width = number_at<std::int32_t>(head, 18, false);
    bmp.height = number_at<std::int32_t>(head, 22, false);
    bmp.upside_down = bmp.height > 0;
    bmp.height = std::abs(bmp.height);
    bmp.bits = number_at<std::uint16_t>(head, 28, false);
    if (bmp.width < 1 || bmp.width > kMaxNodesPerAxis || bmp.height < 1 ||
        bmp.height > kMaxNodesPerAxis || number_at<std::uint16_t>(head, 26, false) != 1) {
        corrupt(fmt::format("{} x {} pixels, {} planes", bmp.width, bmp.height,
                            number_at<std::uint16_t>(head, 26, false)));
    }
    constexpr std::uint32_t kBitFields = 3;
    const std::uint32_t compression = word(30);
    const bool has_masks = compression == kBitFields && bmp.bits == 32;
    if (compression != 0 && !has_masks) {
        unsupported(fmt::format("compression {}", compression));
    }
    if (bmp.bits != 1 && bmp.bits != 4 && bmp.bits != 8 && bmp.bits != 24 && bmp.bits != 32) {
        unsupported(fmt::format("{} bits a pixel", bmp.bits));
    }
    std::uint64_t behind = 14 + header;
    if (has_masks) {
        constexpr std::uint64_t kMasks = 12;
        behind += header == 40 ? kMasks : 0;
        if (head.size() < 14 + 40 + kMasks) {
            corrupt("it is cut short");
        }
        if (word(54) != 0xFF0000U || word(58) != 0xFF00U || word(62) != 0xFFU) {
            unsupported("colours in other bits than those of one byte each");
        }
    }
    bmp.grey.fill(-1);
    if (bmp.bits <= 8) {
        const std::uint32_t most = 1U << static_cast<unsigned>(bmp.bits);
        const std::uint32_t used = word(46) == 0 ? most : word(46);
        if (used > most || head.size() < behind + 4 * std::uint64_t{used}) {
            corrupt(fmt::format("a palette of {} colours", used));
        }
        for (std::uint32_t i = 0; i < used; ++i) {
            const auto* const colour =
                reinterpret_cast<const unsigned char*>(head.data()) + behind + 4 * std::size_t{i};
            if (colour[0] != colour[1] || colour[1] != colour[2]) {
                unsupported(
                    fmt::format("its palette has colours (number {} is red {}, green {}, "
                                "blue {})",
                                i, colour[2], colour[1], colour[0]));
            }
            bmp.grey.at(i) = colour[0];
        }
        behind += 4 * std::uint64_t{used};
    }
    bmp.start = word(10);
    bmp.row = (static_cast<std::uint64_t>(bmp.width) * static_cast<std::uint64_t>(bmp.bits) + 31) /
              32 * 4;
    const std::uint64_t size = regular_file_size(file);
    const std::uint64_t need = bmp.row * static_cast<std::uint64_t>(bmp.height);
    if (bmp.start < behind || bmp.start > size || size - bmp.start < need) {
        corrupt(
            fmt::format("{} bytes of pixels from byte {} on do not lie behind its header of {} "
                        "and within its {}",
                        need, bmp.start, behind, size));
    }
    return bmp;
}

/// The grey value of a pixel; -1 for a colour that is none, -2 for a number without a colour.
int grey_of(const Bmp& bmp, const unsigned char* row, std::int64_t x) {
    if (bmp.bits > 8) {
        const unsigned char* const pixel = row + x * (bmp.bits / 8);
        return pixel[0] == pixel[1] && pixel[1] == pixel[2] ? pixel[0] : -1;
    }
    const std::int64_t of_byte = 8 / bmp.bits;
    const auto shift = static_cast<unsigned>((of_byte - 1 - x % of_byte) * bmp.bits);
    const unsigned number =
        row[x / of_byte] >> shift & ((1U << static_cast<unsigned>(bmp.bits)) - 1);
    const int grey = bmp.grey.at(number);
    return grey < 0 ? -2 : grey;
}

}  // namespace

SlicePicture look_at_bmp(const std::filesystem::path& file) {
    const Bmp bmp = read_bmp_header(file);
    return {bmp.width, bmp.height, 8, bmp.bits > 8, bmp.row};
}

void decode_bmp(const std::filesystem::path& file, const SlicePicture& picture, bool /*full_range*/,
                std::byte* dst) {
    const Bmp bmp = read_bmp_header(file);
    if (bmp.width != picture.width || bmp.height != picture.height) {
        throw Error(ErrorKind::corrupt, {file.string()}, "it has changed since it was looked at");
    }
    const auto bytes =
        file_bytes(file, bmp.start, bmp.row * static_cast<std::uint64_t>(bmp.height));
    std::vector<unsigned char> row(bmp.row);
    for (std::int64_t y = 0; y < bmp.height; ++y) {
        const std::int64_t stored = bmp.upside_down ? bmp.height - 1 - y : y;
        bytes->read(static_cast<std::uint64_t>(stored) * bmp.row,
                    reinterpret_cast<std::byte*>(row.data()), row.size());
        for (std::int64_t x = 0; x < bmp.width; ++x) {
            const int grey = grey_of(bmp, row.data(), x);
            if (grey == -1) {
                refuse_colour(file, x, y);
            }
            if (grey < 0) {
                throw Error(
                    ErrorKind::corrupt, {file.string()},
                    fmt::format("the pixel ({}, {}) has a colour that its palette has not", x, y));
            }
            *dst++ = static_cast<std::byte>(grey);
        }
    }
}

}  // namespace isonest::detail
