// Binary PLY. The format: G. Turk, "The PLY Polygon File Format" (1994).
#include <fmt/format.h>

#include <cstring>

#include "query/mesh/mesh_sections.h"

namespace isonest::detail {

void write_ply(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress) {
    require_32_bits(path, mesh.weld.vertices(), "vertices", "PLY");
    OutputFile file(path, force);
    const AttributeChoice& a = mesh.attributes;
    const std::uint64_t vertices = mesh.weld.vertices();
    const std::string header = fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment isonest\nelement vertex {}\n"
        "property float x\nproperty float y\nproperty float z\n{}{}{}element face {}\n"
        "property list uchar {} vertex_indices\nend_header\n",
        vertices, a.normal ? "property float nx\nproperty float ny\nproperty float nz\n" : "",
        !a.value       ? ""
        : a.wide_value ? "property double value\n"
                       : "property float value\n",
        a.error ? "property float error\n" : "", mesh.weld.triangles(),
        vertices > 0x7FFFFFFFULL ? "uint" : "int");
    file.write_at(0, std::as_bytes(std::span(header)));
    const std::size_t stride = 3 * sizeof(float) + a.width() * sizeof(AttributeWord);
    const std::uint64_t faces = header.size() + vertices * stride;
    write_sections(file, mesh,
                   {{header.size(), stride,
                     [](const VertexRow& v, std::byte* out) {
                         std::memcpy(out, v.position.data(), sizeof(v.position));
                         std::memcpy(out + sizeof(v.position), v.attributes.data(),
                                     v.attributes.size_bytes());
                     }}},
                   {{faces, 1 + 3 * sizeof(std::uint32_t),
                     [](const TriangleRow& t, std::byte* out) {
                         *out++ = std::byte{3};
                         put_indices32(t, out);
                     }}},
                   progress);
    file.publish_as_named();
}

}  // namespace isonest::detail
