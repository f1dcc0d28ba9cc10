// Binary PLY. The format: G. Turk, "The PLY Polygon File Format" (1994).
#include <fmt/format.h>

#include <cstdint>
#include <limits>

#include <isonest/error.h>

#include "query/formats/mesh_sections.h"

namespace isonest::detail {
namespace {

std::string property_of(const VertexAttribute& attribute) {
    if (attribute.name == "normal") {
        return "property float nx\nproperty float ny\nproperty float nz\n";
    }
    return fmt::format("property {} {}\n", attribute.is_double ? "double" : "float",
                       attribute.name);
}

class PlyFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        require_bits(32, layout.vertices, "vertices", "PLY");
        require_labels(layout);
        std::string header = fmt::format(
            "ply\nformat binary_little_endian 1.0\ncomment isonest\n{}{}element vertex {}\n"
            "property float x\nproperty float y\nproperty float z\n",
            layout.unit ? fmt::format("comment unit {}\n", symbol_of(*layout.unit)) : "",
            layout.frame == AnatomicalFrame::unknown
                ? ""
                : fmt::format("comment {}\n", space_text(layout.frame)),
            layout.vertices);
        for (const VertexAttribute& attribute : layout.attributes) {
            header += property_of(attribute);
        }
        header += fmt::format(
            "element face {}\nproperty list uchar {} vertex_indices\n{}end_header\n",
            layout.elements, layout.vertices > 0x7FFFFFFFULL ? "uint" : "int",
            layout.has_sides ? "property int label_behind\nproperty int label_in_front\n" : "");
        create().write_at(0, std::as_bytes(std::span(header)));
        const VertexSection rows{header.size(), true, 0, layout.row_bytes};
        const std::uint64_t faces = header.size() + layout.vertices * rows.stride();
        use({{rows},
             {layout.has_sides ? sided_indices32_section(faces)
                               : indices32_section(faces, std::byte{3})}},
            layout);
    }

  protected:
    [[nodiscard]] bool holds_sides() const override { return true; }

  private:
    /// PLY has no integers of 64 bits.
    void require_labels(const MeshLayout& layout) const {
        using Limits = std::numeric_limits<std::int32_t>;
        const auto [least, most] = layout.sides_range;
        if (layout.has_sides && (least < Limits::min() || most > Limits::max())) {
            throw Error(ErrorKind::limit, {path().string()},
                        fmt::format("the labels {} to {} do not fit into PLY's integers, which "
                                    "have 32 bits",
                                    least, most),
                        {{RemedyKind::other_format, ".vtp,.vtkhdf"}});
        }
    }
};

}  // namespace

std::unique_ptr<MeshSink> ply_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<PlyFile>(path, o);
}

}  // namespace isonest::detail
