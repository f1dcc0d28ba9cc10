// VTKHDF PolyData: HDF5 whose arrays are written in place.
#include "query/mesh/mesh_sections.h"
#include "store/container/polydata_file.h"

namespace isonest::detail {

void write_vtkhdf(const std::filesystem::path& path, bool force, const MeshContent& mesh,
                  Progress& progress) {
    const std::vector<AttributeChoice::Array> arrays = mesh.attributes.arrays();
    PolyDataShape shape;
    shape.points = mesh.weld.vertices();
    shape.triangles = mesh.weld.triangles();
    for (const AttributeChoice::Array& array : arrays) {
        shape.attributes.push_back({array.name, static_cast<int>(array.components), array.wide});
    }
    PolyDataOffsets offsets;
    OutputFile file(path, force, [&](const std::filesystem::path& temporary) {
        offsets = create_polydata(temporary, shape);
    });
    std::vector<VertexSection> vertices{position_section(offsets.points)};
    for (std::size_t i = 0; i < arrays.size(); ++i) {
        vertices.push_back(attribute_section(offsets.attributes[i], arrays[i]));
    }
    const std::vector<TriangleSection> triangles{connectivity_section(offsets.connectivity, 3),
                                                 ends_section(offsets.ends, 3)};
    if (shape.triangles > 0) {
        const std::uint64_t zero = 0;
        file.write_at(offsets.ends - sizeof(zero), std::as_bytes(std::span(&zero, 1)));
    }
    write_sections(file, mesh, vertices, triangles, progress);
    file.publish_as_named();
}

}  // namespace isonest::detail
