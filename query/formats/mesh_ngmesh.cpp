// Neuroglancer's single-resolution mesh: the number of vertices (uint32), their positions
// (float32), and three numbers (uint32) for each triangle. The format:
// Positions are in nanometres, unless their unit is not known.
// https://github.com/google/neuroglancer/blob/master/src/datasource/precomputed/meshes.md
#include "query/formats/mesh_sections.h"

namespace isonest::detail {
namespace {

class NgmeshFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        require_bits(32, layout.vertices, "vertices", "Neuroglancer");
        const auto count = static_cast<std::uint32_t>(layout.vertices);
        create().write_at(0, std::as_bytes(std::span(&count, 1)));
        VertexSection positions = position_section(
            sizeof(count),
            layout.unit ? converted_length(1, *layout.unit, LengthUnit::nanometre) : 1);
        positions.shift = shift();
        use({{positions},
             {indices32_section(sizeof(count) + layout.vertices * positions.stride())}},
            layout);
    }
};

}  // namespace

std::unique_ptr<MeshSink> ngmesh_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<NgmeshFile>(path, o);
}

}  // namespace isonest::detail
