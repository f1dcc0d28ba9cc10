// VTKHDF PolyData: HDF5 whose arrays are written in place.
#include "query/formats/mesh_sections.h"
#include "store/exports/polydata_file.h"

namespace isonest::detail {
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
