// VTK XML PolyData with appended raw data. The format: Kitware, "VTK File Formats".
#include <fmt/format.h>

#include "query/formats/mesh_sections.h"

namespace isonest::detail {
namespace {

/// Collects the arrays of the appended data, each behind its length in bytes.
struct Appended {
    std::string xml;
    std::uint64_t end = 0;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> lengths;  ///< offset, bytes

    /// Returns the offset of the array's data.
    std::uint64_t add(const char* type, std::string_view name, std::size_t components,
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
    /// With so many rows.
    std::uint64_t add(const VertexAttribute& a, std::uint64_t rows) {
        return add(a.is_double ? "Float64" : "Float32", a.name,
                   static_cast<std::size_t>(a.components), rows * a.bytes());
    }
};

/// A text of the field data, byte by byte; nothing if it is empty.
std::string text_field(const char* name, std::string_view text) {
    if (text.empty()) {
        return "";
    }
    std::string bytes;
    for (const char c : text) {
        bytes += fmt::format("{} ", static_cast<int>(static_cast<unsigned char>(c)));
    }
    return fmt::format(
        "<DataArray type=\"String\" Name=\"{}\" NumberOfTuples=\"1\" "
        "format=\"ascii\">{}0</DataArray>\n",
        name, bytes);
}

/// Unit, frame, name and colour, as far as they are known.
std::string field_data(std::optional<LengthUnit> unit, AnatomicalFrame frame,
                       std::string_view title, const std::optional<LabelColor>& color) {
    std::string fields = text_field("unit", unit ? symbol_of(*unit) : std::string_view{}) +
                         text_field("SPACE", frame == AnatomicalFrame::unknown ? std::string_view{}
                                                                               : name_of(frame)) +
                         text_field("Name", title);
    if (color) {
        constexpr double kMost = 255;
        fields += fmt::format(
            "<DataArray type=\"Float32\" Name=\"Color\" NumberOfComponents=\"3\" "
            "NumberOfTuples=\"1\" format=\"ascii\">{:.9g} {:.9g} {:.9g}</DataArray>\n",
            (*color)[0] / kMost, (*color)[1] / kMost, (*color)[2] / kMost);
    }
    return fields.empty() ? "" : "<FieldData>\n" + fields + "</FieldData>\n";
}

class VtpFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        const std::uint64_t nv = layout.vertices;
        const std::uint64_t nt = layout.elements;
        const bool lines = layout.corners == 2;
        const std::size_t corners = lines ? 2 : 3;
        const std::string cells = lines ? "Lines" : "Polys";
        Sections sections;
        Appended data;
        data.xml = fmt::format(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" "
            "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n{}"
            "<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" "
            "NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n",
            field_data(layout.unit, layout.frame, title(), color()), nv, lines ? nt : 0,
            lines ? 0 : nt);
        data.xml += fmt::format("<PointData{}{}>\n",
                                layout.find("normal") != nullptr ? " Normals=\"normal\"" : "",
                                layout.find("value") != nullptr   ? " Scalars=\"value\""
                                : layout.find("error") != nullptr ? " Scalars=\"error\""
                                                                  : "");
        for (const VertexAttribute& a : layout.attributes) {
            sections.vertices.push_back(attribute_section(data.add(a, nv), a));
        }
        data.xml += fmt::format("</PointData>\n<CellData{}>\n",
                                layout.has_sides ? " Scalars=\"BoundaryLabels\"" : "");
        for (const VertexAttribute& a : layout.attributes) {
            if (a.same_in_element) {
                sections.elements.push_back(common_section(data.add(a, nt), a));
            }
        }
        if (layout.has_sides) {
            sections.elements.push_back(sides_section(
                data.add("Int64", "BoundaryLabels", 2, nt * 2 * sizeof(std::int64_t))));
        }
        data.xml += "</CellData>\n<Points>\n";
        sections.vertices.push_back(
            position_section(data.add("Float32", "points", 3, nv * 3 * sizeof(float))));
        data.xml += fmt::format("</Points>\n<{}>\n", cells);
        sections.elements.push_back(connectivity_section(
            data.add("Int64", "connectivity", 1, nt * corners * sizeof(std::int64_t)), corners));
        sections.elements.push_back(
            ends_section(data.add("Int64", "offsets", 1, nt * sizeof(std::int64_t)), corners));
        data.xml +=
            fmt::format("</{}>\n</Piece>\n</PolyData>\n<AppendedData encoding=\"raw\">\n_", cells);

        const OutputFile& out = create();
        out.write_at(0, std::as_bytes(std::span(data.xml)));
        const std::uint64_t base = data.xml.size();
        for (const auto& [offset, bytes] : data.lengths) {
            out.write_at(base + offset, std::as_bytes(std::span(&bytes, 1)));
        }
        const std::string tail = "\n</AppendedData>\n</VTKFile>\n";
        out.write_at(base + data.end, std::as_bytes(std::span(tail)));
        sections.shift(base);
        use(std::move(sections), layout);
    }

  protected:
    [[nodiscard]] bool holds_lines() const override { return true; }
    [[nodiscard]] bool holds_sides() const override { return true; }
};

}  // namespace

std::unique_ptr<MeshSink> vtp_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<VtpFile>(path, o);
}

}  // namespace isonest::detail
