// PNG pictures.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace isonest::tools {

/// Writes 8-bit RGB rows, top row first; the file appears whole. Throws Error{io}.
void write_png(const std::filesystem::path& path, int width, int height,
               const std::vector<std::uint8_t>& rgb);

}  // namespace isonest::tools
