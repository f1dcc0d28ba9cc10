// VTK XML PolyData with appended raw data. The format: Kitware, "VTK File Formats".
#include <fmt/format.h>

#include "query/mesh/mesh_sections.h"

namespace isonest::detail {
namespace {

/// Collects the arrays of the appended data, each behind its length in bytes.
struct Appended {
    std::string xml;
    std::uint64_t end = 0;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> lengths;  ///< offset, bytes

    /// Returns the offset of the array's data.
    std::uint64_t add(const char* type, const char* name, std::size_t components,
                      std::uint64_t bytes) {
        xml += fmt::format(
            "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" "
            "offset=\"{}\"/>\n",
            type, name, components, end);
        lengths.emplace_back(end, bytes);
        const std::uint64_t data = end + sizeof(std::uint64_t);
        end = data + bytes;
        return data;
    }
};

}  // namespace

void write_vtp(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress) {
    OutputFile file(path, force);
    const std::uint64_t nv = mesh.weld.vertices();
    const std::uint64_t nt = mesh.weld.triangles();
    std::vector<VertexSection> vertices;
    std::vector<TriangleSection> triangles;
    Appended data;
    data.xml = fmt::format(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" "
        "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n"
        "<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" "
        "NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n",
        nv, mesh.lines ? nt : 0, mesh.lines ? 0 : nt);
    const std::string cells = mesh.lines ? "Lines" : "Polys";
    const std::size_t corners = mesh.lines ? 2 : 3;
    const AttributeChoice& a = mesh.attributes;
    data.xml += fmt::format("<PointData{}{}>\n", a.normal ? " Normals=\"normal\"" : "",
                            a.value   ? " Scalars=\"value\""
                            : a.error ? " Scalars=\"error\""
                                      : "");
    for (const AttributeChoice::Array& array : a.arrays()) {
        vertices.push_back(
            attribute_section(data.add(array.wide ? "Float64" : "Float32", array.name,
                                       array.components, nv * array.bytes()),
                              array));
    }
    data.xml += "</PointData>\n<Points>\n";
    vertices.push_back(position_section(data.add("Float32", "points", 3, nv * 3 * sizeof(float))));
    data.xml += fmt::format("</Points>\n<{}>\n", cells);
    triangles.push_back(connectivity_section(
        data.add("Int64", "connectivity", 1, nt * corners * sizeof(std::int64_t)), corners));
    triangles.push_back(
        ends_section(data.add("Int64", "offsets", 1, nt * sizeof(std::int64_t)), corners));
    data.xml +=
        fmt::format("</{}>\n</Piece>\n</PolyData>\n<AppendedData encoding=\"raw\">\n_", cells);
    file.write_at(0, std::as_bytes(std::span(data.xml)));
    const std::uint64_t base = data.xml.size();
    for (const auto& [offset, bytes] : data.lengths) {
        file.write_at(base + offset, std::as_bytes(std::span(&bytes, 1)));
    }
    shift(base, vertices, triangles);
    write_sections(file, mesh, vertices, triangles, progress);
    const std::string tail = "\n</AppendedData>\n</VTKFile>\n";
    file.write_at(base + data.end, std::as_bytes(std::span(tail)));
    file.publish_as_named();
}

}  // namespace isonest::detail
