// One picture of a stack: what it is, and its numbers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace isonest::detail {

struct SlicePicture {
    std::int64_t width = 0;
    std::int64_t height = 0;
    int bits = 8;            ///< of a value: 1, 2, 4, 8 or 16
    bool colours = false;    ///< red, green and blue are stored, and have to be equal everywhere
    std::uint64_t heap = 0;  ///< bytes that decoding it takes, beside the numbers
};

/// Throws Error{corrupt, io, not_found, unsupported}.
SlicePicture look_at_png(const std::filesystem::path& file);
SlicePicture look_at_bmp(const std::filesystem::path& file);

/// All numbers, the row at the top first, each in one byte, or of 16 bits in two of native
/// endianness. `full_range`: those of 1, 2 and 4 bits are scaled to 0 to 255.
/// REQUIRES: `picture` is what the file was. Throws Error{corrupt, io}, and Error{unsupported} for
/// a pixel with a colour.
void decode_png(const std::filesystem::path& file, const SlicePicture& picture, bool full_range,
                std::byte* dst);
void decode_bmp(const std::filesystem::path& file, const SlicePicture& picture, bool full_range,
                std::byte* dst);

/// Throws Error{unsupported}, for a pixel that is not grey.
[[noreturn]] void refuse_colour(const std::filesystem::path& file, std::int64_t x, std::int64_t y);

}  // namespace isonest::detail
