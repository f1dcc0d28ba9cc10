#include "query/mesh/mesh_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

using Writer = void (*)(const std::filesystem::path&, bool, const MeshContent&, Progress&);
struct Format {
    std::string_view extension;
    Writer write;
};
constexpr std::array<Format, 6> kFormats{{{".ply", write_ply},
                                          {".stl", write_stl},
                                          {".obj", write_obj},
                                          {".vtp", write_vtp},
                                          {".vtkhdf", write_vtkhdf},
                                          {".glb", write_glb}}};

}  // namespace

MeshFormat mesh_format_of(const std::filesystem::path& path) {
    std::string end = path.extension().string();
    std::transform(end.begin(), end.end(), end.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    for (std::size_t i = 0; i < kFormats.size(); ++i) {
        if (kFormats[i].extension == end) {
            return static_cast<MeshFormat>(i);
        }
    }
    throw Error(ErrorKind::invalid_argument,
                fmt::format("{}: a mesh's name must end with .ply, .stl, .obj, .vtp, .vtkhdf or "
                            ".glb, which chooses its format",
                            path.string()));
}

bool holds_float64(MeshFormat format) {
    return format == MeshFormat::ply || format == MeshFormat::vtp || format == MeshFormat::vtkhdf;
}

void write_mesh(const std::filesystem::path& path, bool force, const PartStore& parts,
                const Weld& weld, const AttributeChoice& attributes, bool lines,
                Progress& progress) {
    const auto format = static_cast<std::size_t>(mesh_format_of(path));
    kFormats.at(format).write(path, force, {parts, weld, attributes, lines}, progress);
}

void require_lines(const std::filesystem::path& path) {
    const MeshFormat format = mesh_format_of(path);
    if (format != MeshFormat::vtp && format != MeshFormat::obj) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}: lines are written as .vtp or .obj", path.string()));
    }
}

void require_32_bits(const std::filesystem::path& path, std::uint64_t count, const char* what,
                     const char* format) {
    if (count > 0xFFFFFFFFULL) {
        throw Error(ErrorKind::limit,
                    fmt::format("{}: the surface has {} {}, more than {} can number (2^32 - 1); "
                                "write .vtp or .vtkhdf, extract a --box of it or allow a larger "
                                "--error",
                                path.string(), count, what, format));
    }
}

}  // namespace isonest::detail
