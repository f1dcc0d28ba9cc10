#include "tools/drawing/input/mesh_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>

#include <isonest/error.h>

namespace isonest::detail::cli {
namespace {

constexpr std::size_t kBuffer = std::size_t{1} << 20U;

struct Format {
    const char* extension;
    MeshInput read;
};
constexpr std::array<Format, 7> kFormats{{{".stl", read_stl},
                                          {".obj", read_obj},
                                          {".glb", read_glb},
                                          {".3mf", read_3mf},
                                          {".vtp", read_vtp},
                                          {".vtkhdf", read_vtkhdf},
                                          {".ngmesh", read_ngmesh}}};

const Format* format_of(const std::filesystem::path& path) {
    std::string end = path.extension().string();
    std::transform(end.begin(), end.end(), end.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    const auto* const found = std::find_if(kFormats.begin(), kFormats.end(),
                                           [&](const Format& f) { return end == f.extension; });
    return found == kFormats.end() ? nullptr : found;
}

}  // namespace

const std::byte* MeshBytes::at(std::uint64_t offset, std::uint64_t bytes) const {
    if (offset > size() || bytes > size() - offset) {
        fail(fmt::format("byte {}: {} bytes are to follow, but the file has {}", offset, bytes,
                         size()));
    }
    return file_.bytes().data() + offset;
}

void MeshBytes::fail(const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {name_}, problem, {{RemedyKind::good_copy}});
}

PlyScratch::PlyScratch(const std::filesystem::path& folder, std::string name)
    : name_(std::move(name)),
      folder_(folder),
      vertex_rows_{ScratchFile(folder)},
      face_rows_{ScratchFile(folder)} {}

void PlyScratch::fail(const std::string& problem) const {
    throw Error(ErrorKind::corrupt, {name_}, problem, {{RemedyKind::good_copy}});
}

void PlyScratch::Rows::add(std::span<const std::byte> row) {
    buffer.insert(buffer.end(), row.begin(), row.end());
    if (buffer.size() >= kBuffer) {
        flush();
    }
}

void PlyScratch::Rows::flush() {
    file.write_at(written, buffer);
    written += buffer.size();
    buffer.clear();
}

void PlyScratch::vertex(const std::array<double, 3>& position, double value) {
    std::array<float, 4> row{};
    for (std::size_t a = 0; a < 3; ++a) {
        row.at(a) = static_cast<float>(position.at(a));
        if (!std::isfinite(row.at(a))) {
            fail(fmt::format("vertex {} has a coordinate that is not finite", vertices_));
        }
    }
    row[3] = static_cast<float>(value);
    has_values_ = has_values_ || !std::isnan(value);
    if (++vertices_ >= std::numeric_limits<std::uint32_t>::max()) {
        throw Error(ErrorKind::limit, {name_}, "has more than 2^32 vertices");
    }
    vertex_rows_.add(std::as_bytes(std::span(row)));
}

void PlyScratch::triangle(const std::array<std::uint64_t, 3>& corners) {
    std::array<std::byte, 13> row{std::byte{3}};
    for (std::size_t i = 0; i < 3; ++i) {
        largest_ = std::max(largest_, corners.at(i));
        const auto corner = static_cast<std::uint32_t>(corners.at(i));
        std::memcpy(row.data() + 1 + 4 * i, &corner, sizeof(corner));
    }
    ++triangles_;
    face_rows_.add(row);
}

ScratchFile PlyScratch::finish() {
    if (triangles_ > 0 && largest_ >= vertices_) {
        fail(fmt::format("a triangle names vertex {}, but there are {}", largest_, vertices_));
    }
    vertex_rows_.flush();
    face_rows_.flush();
    const std::string header = fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n"
        "property float y\nproperty float z\nproperty float {}\nelement face {}\n"
        "property list uchar uint vertex_indices\nend_header\n",
        vertices_, has_values_ ? "value" : "nothing", triangles_);
    ScratchFile ply(folder_);
    ply.write_at(0, std::as_bytes(std::span(header)));
    std::uint64_t at = header.size();
    std::vector<std::byte> buffer;
    for (Rows* const rows : {&vertex_rows_, &face_rows_}) {
        for (std::uint64_t from = 0; from < rows->written; from += buffer.size()) {
            buffer.resize(std::min<std::uint64_t>(kBuffer, rows->written - from));
            rows->file.read_at(from, buffer);
            ply.write_at(at, buffer);
            at += buffer.size();
        }
    }
    return ply;
}

/// 80 bytes of text, the number of triangles, and 50 bytes for each.
void read_stl(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    constexpr std::uint64_t kHeader = 84;
    constexpr std::uint64_t kRow = 50;
    const auto count = bytes.number<std::uint32_t>(80);
    if (bytes.size() != kHeader + kRow * count) {
        throw Error(ErrorKind::unsupported, {path.string()},
                    fmt::format("{} bytes are no binary STL of {} triangles (STL in text is not "
                                "read)",
                                bytes.size(), count));
    }
    for (std::uint64_t i = 0; i < count; ++i) {
        if (i % 65536 == 0) {
            progress.check();
        }
        std::array<std::uint64_t, 3> corners{};
        for (std::uint64_t c = 0; c < 3; ++c) {
            const std::uint64_t at = kHeader + kRow * i + 12 + 12 * c;
            corners.at(c) = to.vertices();
            to.vertex(
                {bytes.number<float>(at), bytes.number<float>(at + 4), bytes.number<float>(at + 8)},
                NAN);
        }
        to.triangle(corners);
    }
}

void read_ngmesh(const std::filesystem::path& path, PlyScratch& to, Progress& progress) {
    const MeshBytes bytes(path);
    const std::uint64_t count = bytes.number<std::uint32_t>(0);
    for (std::uint64_t i = 0; i < count; ++i) {
        const std::uint64_t at = 4 + 12 * i;
        to.vertex(
            {bytes.number<float>(at), bytes.number<float>(at + 4), bytes.number<float>(at + 8)},
            NAN);
    }
    progress.check();
    const std::uint64_t begin = 4 + 12 * count;
    if ((bytes.size() - begin) % 12 != 0) {
        bytes.fail("its triangles are cut off");
    }
    for (std::uint64_t at = begin; at < bytes.size(); at += 12) {
        to.triangle({bytes.number<std::uint32_t>(at), bytes.number<std::uint32_t>(at + 4),
                     bytes.number<std::uint32_t>(at + 8)});
    }
}

bool is_converted_mesh(const std::filesystem::path& path) {
    return format_of(path) != nullptr;
}

PlyMesh open_mesh(const std::filesystem::path& path, const std::string& value,
                  const std::filesystem::path& folder, Progress& progress) {
    const Format* const format = format_of(path);
    if (format == nullptr) {
        return PlyMesh(path, value);
    }
    PlyScratch scratch(folder, path.string());
    format->read(path, scratch, progress);
    const ScratchFile ply = scratch.finish();
    return {ply.descriptor(), path, value};
}

}  // namespace isonest::detail::cli
