#include "tools/png.h"

#include <fmt/format.h>

#include "store/error.h"
#include "store/output_file.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#pragma GCC diagnostic ignored "-Wshadow"
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#include <stb/stb_image_write.h>
#pragma GCC diagnostic pop

namespace isonest::tools {

void write_png(const std::filesystem::path& path, int width, int height,
               const std::vector<std::uint8_t>& rgb) {
    const std::filesystem::path temporary = temporary_name(path);
    if (stbi_write_png(temporary.c_str(), width, height, 3, rgb.data(), 3 * width) == 0) {
        std::error_code ignored;
        std::filesystem::remove(temporary, ignored);
        throw Error(ErrorKind::io, fmt::format("{}: cannot write the picture", path.string()));
    }
    publish(temporary, path, true);
}

}  // namespace isonest::tools
