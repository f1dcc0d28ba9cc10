#include "tools/png_writer.h"

#include <fmt/format.h>
#include <strings.h>

#include <memory>
#include <vector>

#include "store/error.h"
#include "store/output_file.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#ifndef __clang_analyzer__  // tools/lint is about our code
#define STB_IMAGE_WRITE_IMPLEMENTATION
#endif
#define STB_IMAGE_WRITE_STATIC
#define STBI_WRITE_NO_STDIO
#include <stb/stb_image_write.h>
#pragma GCC diagnostic pop

namespace isonest::cli {
namespace {

void append(void* context, void* data, int size) {
    auto& bytes = *static_cast<std::vector<std::uint8_t>*>(context);
    const auto* const begin = static_cast<const std::uint8_t*>(data);
    bytes.insert(bytes.end(), begin, begin + size);
}

}  // namespace

bool is_png(const std::filesystem::path& path) {
    const std::string end = path.extension().string();
    return ::strcasecmp(end.c_str(), ".png") == 0;
}

void write_png(const std::filesystem::path& path, int width, int height,
               std::span<const std::uint8_t> rgb) {
    std::vector<std::uint8_t> bytes;
    if (stbi_write_png_to_func(&append, &bytes, width, height, 3, rgb.data(), 3 * width) == 0) {
        throw Error(ErrorKind::limit,
                    fmt::format("{}: cannot encode {} x {} pixels", path.string(), width, height));
    }
    OutputFile file(path, true);
    file.write_at(0, std::as_bytes(std::span(bytes)));
    file.publish_as_named();
}

}  // namespace isonest::cli
