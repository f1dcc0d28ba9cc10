#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "query/formats/mesh_files.h"
#include "store/exports/polydata_file.h"

namespace isonest::detail {

// VTK XML PolyData with binary data in the XML, which every version of VTK can read with every
// version of expat. This is not true of raw appended data, which is not valid XML. The format:
// Kitware, "VTK File Formats".

namespace {

/// Collects the XML and the positions of the arrays in it. Each array is the base64 encoding of its
/// length in bytes (uint64) followed by the numbers.
class Inline {
  public:
    explicit Inline(std::string xml) : xml_(std::move(xml)) {}

    Inline& operator+=(std::string_view xml) {
        xml_ += xml;
        return *this;
    }
    Base64Array add(const char* type, std::string_view name, std::size_t components,
                    std::uint64_t bytes) {
        xml_ += fmt::format(
            "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"binary\">\n",
            type, name, components);
        keep_text();
        const Base64Array array{end_, kLength + bytes};
        end_ += array.letters();
        arrays_.push_back(array);
        xml_ = "\n</DataArray>\n";
        return array;
    }
    /// Adds an array with this number of rows.
    Base64Array add(const VertexAttribute& a, std::uint64_t rows) {
        return add(a.is_double ? "Float64" : "Float32", a.name,
                   static_cast<std::size_t>(a.components), rows * a.bytes());
    }
    /// Calls text(place, xml) for all XML, and array(array, length) for the lengths.
    template <class Text, class Array>
    void write(const Text& text, const Array& array) {
        keep_text();
        for (const auto& [place, xml] : texts_) {
            text(place, xml);
        }
        for (const Base64Array& a : arrays_) {
            array(a, a.bytes - kLength);
        }
    }
    static constexpr std::uint64_t kLength = sizeof(std::uint64_t);

  private:
    void keep_text() {
        texts_.emplace_back(end_, xml_);
        end_ += xml_.size();
        xml_.clear();
    }
    std::string xml_;  ///< XML without a position yet
    std::vector<std::pair<std::uint64_t, std::string>> texts_;
    std::vector<Base64Array> arrays_;
    std::uint64_t end_ = 0;
};

/// For an array that was added to Inline.
template <class Section>
Section in_base64(Section section, const Base64Array& array) {
    section.offset = Inline::kLength;
    section.base64 = array;
    return section;
}

/// A text of the field data, byte by byte; empty if the text is empty.
std::string text_field(const char* name, std::string_view text) {
    if (text.empty()) {
        return "";
    }
    std::string bytes;
    for (const char c : text) {
        bytes += fmt::format("{} ", static_cast<int>(static_cast<unsigned char>(c)));
    }
    return fmt::format(
        "<Array type=\"String\" Name=\"{}\" NumberOfTuples=\"1\" format=\"ascii\">{}0</Array>\n",
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
        constexpr double kMax = 255;
        fields += fmt::format(
            "<DataArray type=\"Float32\" Name=\"Color\" NumberOfComponents=\"3\" "
            "NumberOfTuples=\"1\" format=\"ascii\">{:.9g} {:.9g} {:.9g}</DataArray>\n",
            (*color)[0] / kMax, (*color)[1] / kMax, (*color)[2] / kMax);
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
        Inline data(
            fmt::format("<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" "
                        "byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n{}"
                        "<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" "
                        "NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n",
                        field_data(layout.unit, layout.frame, title(), color()), nv, lines ? nt : 0,
                        lines ? 0 : nt));
        data += fmt::format("<PointData{}{}>\n",
                            layout.find("normal") != nullptr ? " Normals=\"normal\"" : "",
                            layout.find("value") != nullptr   ? " Scalars=\"value\""
                            : layout.find("error") != nullptr ? " Scalars=\"error\""
                                                              : "");
        for (const VertexAttribute& a : layout.attributes) {
            sections.vertices.push_back(in_base64(attribute_section(0, a), data.add(a, nv)));
        }
        data += fmt::format("</PointData>\n<CellData{}>\n",
                            layout.has_sides ? " Scalars=\"BoundaryLabels\"" : "");
        for (const VertexAttribute& a : layout.attributes) {
            if (a.same_in_element) {
                sections.elements.push_back(in_base64(common_section(0, a), data.add(a, nt)));
            }
        }
        if (layout.has_sides) {
            sections.elements.push_back(
                in_base64(sides_section(0),
                          data.add("Int64", "BoundaryLabels", 2, nt * 2 * sizeof(std::int64_t))));
        }
        data += "</CellData>\n<Points>\n";
        sections.vertices.push_back(in_base64(
            position_section(0), data.add("Float32", "points", 3, nv * 3 * sizeof(float))));
        data += fmt::format("</Points>\n<{}>\n", cells);
        sections.elements.push_back(
            in_base64(connectivity_section(0, corners),
                      data.add("Int64", "connectivity", 1, nt * corners * sizeof(std::int64_t))));
        sections.elements.push_back(in_base64(
            ends_section(0, corners), data.add("Int64", "offsets", 1, nt * sizeof(std::int64_t))));
        data += fmt::format("</{}>\n</Piece>\n</PolyData>\n</VTKFile>\n", cells);

        const OutputFile& out = create();
        use(std::move(sections), layout);
        data.write(
            [&](std::uint64_t place, const std::string& xml) {
                out.write_at(place, std::as_bytes(std::span(xml)));
            },
            [&](const Base64Array& array, std::uint64_t bytes) {
                put(array, 0, std::as_bytes(std::span(&bytes, 1)));
            });
    }

  protected:
    [[nodiscard]] bool holds_lines() const override { return true; }
    [[nodiscard]] bool holds_sides() const override { return true; }
};

}  // namespace

std::unique_ptr<MeshSink> vtp_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<VtpFile>(path, o);
}

// VTKHDF PolyData: HDF5 whose arrays are written in place.

namespace {

class VtkhdfFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        PolyDataShape shape;
        shape.points = layout.vertices;
        shape.triangles = layout.elements;
        shape.labels_of_triangles = layout.has_sides;
        shape.unit = layout.unit ? symbol_of(*layout.unit) : "";
        shape.space = layout.frame == AnatomicalFrame::unknown ? "" : name_of(layout.frame);
        for (const VertexAttribute& a : layout.attributes) {
            shape.attributes.push_back({a.name, a.components, a.is_double, a.same_in_element});
        }
        PolyDataOffsets offsets;
        const OutputFile& out = create([&](const std::filesystem::path& temporary) {
            offsets = create_polydata(temporary, shape);
        });
        Sections sections{
            {position_section(offsets.points)},
            {connectivity_section(offsets.connectivity, 3), ends_section(offsets.ends, 3)}};
        for (std::size_t i = 0; i < layout.attributes.size(); ++i) {
            sections.vertices.push_back(
                attribute_section(offsets.attributes[i], layout.attributes[i]));
            if (layout.attributes[i].same_in_element) {
                sections.elements.push_back(
                    common_section(offsets.attributes_of_triangles[i], layout.attributes[i]));
            }
        }
        if (layout.has_sides) {
            sections.elements.push_back(sides_section(offsets.labels_of_triangles));
        }
        if (shape.triangles > 0) {
            const std::uint64_t zero = 0;
            out.write_at(offsets.ends - sizeof(zero), std::as_bytes(std::span(&zero, 1)));
        }
        use(std::move(sections), layout);
    }

  protected:
    [[nodiscard]] bool holds_sides() const override { return true; }
};

}  // namespace

std::unique_ptr<MeshSink> vtkhdf_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<VtkhdfFile>(path, o);
}

}  // namespace isonest::detail
