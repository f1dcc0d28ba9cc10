// Binary STL: 80 bytes of text, the number of triangles, and 50 bytes for each. The format: 3D
// Systems, "Stereolithography Interface Specification" (1988).
#include <fmt/format.h>

#include <cmath>
#include <cstring>

#include "query/mesh/mesh_sections.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

std::array<float, 3> normal_of(const std::array<std::array<float, 3>, 3>& p) {
    Double3 a{};
    Double3 b{};
    for (std::size_t i = 0; i < 3; ++i) {
        a[i] = static_cast<double>(p[1][i]) - static_cast<double>(p[0][i]);
        b[i] = static_cast<double>(p[2][i]) - static_cast<double>(p[0][i]);
    }
    const Double3 n = cross(a, b);
    const double size = std::hypot(n[0], n[1], n[2]);
    std::array<float, 3> out{};
    for (std::size_t i = 0; i < 3 && size > 0; ++i) {
        out[i] = static_cast<float>(n[i] / size);
    }
    return out;
}

}  // namespace

void write_stl(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress) {
    constexpr std::size_t kHeader = 80;
    constexpr std::size_t kRow = 50;
    require_32_bits(path, mesh.weld.triangles(), "triangles", "STL");
    OutputFile file(path, force);
    std::array<char, kHeader + sizeof(std::uint32_t)> header{"binary STL, isonest"};
    const auto count = static_cast<std::uint32_t>(mesh.weld.triangles());
    std::memcpy(header.data() + kHeader, &count, sizeof(count));
    file.write_at(0, std::as_bytes(std::span(header)));
    write_sections(file, mesh, {},
                   {{header.size(), kRow,
                     [](const TriangleRow& t, std::byte* out) {
                         const auto n = normal_of(t.positions);
                         std::memcpy(out, n.data(), sizeof(n));
                         std::memcpy(out + sizeof(n), t.positions.data(), sizeof(t.positions));
                         std::memset(out + sizeof(n) + sizeof(t.positions), 0, 2);
                     }}},
                   progress);
    file.publish_as_named();
}

}  // namespace isonest::detail
