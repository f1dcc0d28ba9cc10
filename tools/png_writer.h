// PNG files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

namespace isonest::cli {

/// Whether the name ends with .png, in any case.
bool is_png(const std::filesystem::path& path);

/// Writes 8-bit RGB pixels, rows from the top, as `path`, replacing it; whole or not at all.
/// REQUIRES: rgb.size() == 3 * width * height. Throws Error{io, invalid_argument, not_found}.
void write_png(const std::filesystem::path& path, int width, int height,
               std::span<const std::uint8_t> rgb);

}  // namespace isonest::cli
