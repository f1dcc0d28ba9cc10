// VTKHDF PolyData: HDF5 whose arrays are written in place.
#include <array>
#include <cstring>

#include "query/mesh_sections.h"
#include "store/polydata_file.h"

namespace isonest {

void write_vtkhdf(const std::filesystem::path& path, bool force, const MeshContent& mesh,
                  Progress& progress) {
    const AttributeChoice& a = mesh.attributes;
    PolyDataShape shape;
    shape.points = mesh.weld.vertices();
    shape.triangles = mesh.weld.triangles();
    if (a.normal) {
        shape.attributes.push_back({"normal", 3});
    }
    if (a.value) {
        shape.attributes.push_back({"value", 1});
    }
    if (a.error) {
        shape.attributes.push_back({"error", 1});
    }
    PolyDataOffsets offsets;
    OutputFile file(path, force, [&](const std::filesystem::path& temporary) {
        offsets = create_polydata(temporary, shape);
    });
    std::vector<VertexSection> vertices{position_section(offsets.points)};
    std::size_t first = 0;
    for (std::size_t i = 0; i < shape.attributes.size(); ++i) {
        const auto count = static_cast<std::size_t>(shape.attributes[i].components);
        vertices.push_back(attribute_section(offsets.attributes[i], first, count));
        first += count;
    }
    const std::vector<TriangleSection> triangles{
        {offsets.connectivity, 3 * sizeof(std::int64_t),
         [](const TriangleRow& t, std::byte* out) {
             std::memcpy(out, t.corners.data(), sizeof(t.corners));
         }},
        {offsets.ends, sizeof(std::int64_t), [](const TriangleRow& t, std::byte* out) {
             const std::uint64_t end = 3 * (t.index + 1);
             std::memcpy(out, &end, sizeof(end));
         }}};
    if (shape.triangles > 0) {
        const std::uint64_t zero = 0;
        file.write_at(offsets.ends - sizeof(zero), std::as_bytes(std::span(&zero, 1)));
    }
    write_sections(file, mesh, vertices, triangles, progress);
    file.publish_as_named();
}

}  // namespace isonest
