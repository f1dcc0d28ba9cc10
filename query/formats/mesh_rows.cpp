#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include <isonest/error.h>

#include "query/formats/mesh_files.h"
#include "store/base/json_text.h"

namespace isonest::detail {

// Binary PLY. The format: G. Turk, "The PLY Polygon File Format" (1994).

namespace {

std::string property_of(const VertexAttribute& attribute) {
    if (attribute.name == "normal") {
        return "property float nx\nproperty float ny\nproperty float nz\n";
    }
    const char* const type = attribute.is_double ? "double" : "float";
    if (attribute.components == 3) {
        return fmt::format("property {0} {1}_x\nproperty {0} {1}_y\nproperty {0} {1}_z\n", type,
                           attribute.name);
    }
    return fmt::format("property {} {}\n", type, attribute.name);
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
        if (colors()) {
            header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        }
        header += fmt::format(
            "element face {}\nproperty list uchar {} vertex_indices\n{}end_header\n",
            layout.elements, layout.vertices > 0x7FFFFFFFULL ? "uint" : "int",
            layout.has_sides ? "property int label_behind\nproperty int label_in_front\n" : "");
        create().write_at(0, std::as_bytes(std::span(header)));
        VertexSection rows{header.size(), true, 0, layout.row_bytes};
        if (colors()) {
            rows.color = color_scale(*colors(), layout, ColorForm::displayed8);
        }
        const std::uint64_t faces = header.size() + layout.vertices * rows.stride();
        use({{rows},
             {layout.has_sides ? sided_indices32_section(faces)
                               : indices32_section(faces, std::byte{3})}},
            layout);
    }

  protected:
    [[nodiscard]] bool holds_sides() const override { return true; }
    [[nodiscard]] bool holds_colors() const override { return true; }
    [[nodiscard]] bool holds_fields() const override { return true; }

  private:
    /// PLY has no 64-bit integers.
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

// Binary STL: 80 bytes of text, the number of triangles, and 50 bytes for each. The format: 3D
// Systems, "Stereolithography Interface Specification" (1988).

namespace {

class StlFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    void begin_file(const MeshLayout& layout) override {
        constexpr std::size_t kHeader = 80;
        require_bits(32, layout.elements, "triangles", "STL");
        std::array<char, kHeader + sizeof(std::uint32_t)> header{"binary STL, isonest"};
        std::string text(header.data());
        if (layout.unit) {
            text += fmt::format(", unit {}", symbol_of(*layout.unit));
        }
        if (layout.frame != AnatomicalFrame::unknown) {
            text += ", " + space_text(layout.frame);
        }
        std::copy(text.begin(), text.end(), header.begin());
        const auto count = static_cast<std::uint32_t>(layout.elements);
        std::memcpy(header.data() + kHeader, &count, sizeof(count));
        create().write_at(0, std::as_bytes(std::span(header)));
        use({{}, {facet_section(header.size())}}, layout);
    }
};

}  // namespace

std::unique_ptr<MeshSink> stl_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<StlFile>(path, o);
}

// glTF 2.0 binary (GLB). The format: Khronos Group, "glTF 2.0 Specification" (2021).

namespace {

std::uint64_t padded(std::uint64_t bytes) {
    return (bytes + 3) / 4 * 4;
}

/// Buffer views and accessors, one of each for every array.
struct Arrays {
    std::string views;
    std::string accessors;
    std::uint64_t end = 0;
    int count = 0;

    std::uint64_t add(std::uint64_t bytes, std::uint64_t n, int component, const char* type,
                      int target, const std::string& extra = "") {
        const char* const comma = count > 0 ? "," : "";
        views += fmt::format("{}{{\"buffer\":0,\"byteOffset\":{},\"byteLength\":{},\"target\":{}}}",
                             comma, end, bytes, target);
        accessors += fmt::format(
            "{}{{\"bufferView\":{},\"componentType\":{},\"count\":{},\"type\":\"{}\"{}}}", comma,
            count, component, n, type, extra);
        const std::uint64_t at = end;
        end += padded(bytes);
        ++count;
        return at;
    }
};

/// glTF's unit is the metre. Coordinates are not changed; the node scales them, unless their unit
/// is unknown.
std::string scale_of(std::optional<LengthUnit> unit) {
    return !unit || *unit == LengthUnit::metre
               ? ""
               : fmt::format(R"(,"scale":[{0},{0},{0}])",
                             converted_length(1, *unit, LengthUnit::metre));
}

/// A surface has no inside: it is visible from both sides. Without explicit properties viewers
/// render it as metal. glTF's colours are linear.
std::string material_of(const std::string& title, const std::optional<LabelColor>& color) {
    return fmt::format(
        R"({{"name":{},"doubleSided":true,"pbrMetallicRoughness":{{"baseColorFactor":)"
        R"([{},1],"metallicFactor":0,"roughnessFactor":0.7}}}})",
        json_string(title.empty() ? "surface" : title),
        color ? fmt::format("{:.6f},{:.6f},{:.6f}", linear_of((*color)[0]), linear_of((*color)[1]),
                            linear_of((*color)[2]))
              : std::string("0.62,0.68,0.76"));
}

class GlbFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    [[nodiscard]] bool holds_float64() const override { return false; }
    void begin_file(const MeshLayout& layout) override {
        std::vector<FileObject> object = single(layout);
        if (layout.elements == 0) {
            object.clear();
        }
        begin_objects(std::move(object));
        if (layout.elements > 0) {
            begin_object(0);
        } else {
            use({}, layout);
        }
    }

    void begin_objects(std::vector<FileObject> objects) override {
        objects_ = std::move(objects);
        placed_ = {};
        Arrays arrays;
        std::string meshes;
        std::string nodes;
        std::string numbers;
        std::string materials;
        for (std::size_t i = 0; i < objects_.size(); ++i) {
            const FileObject& object = objects_[i];
            require_bits(32, object.layout.vertices, "vertices", "glTF");
            Sections sections;
            const std::string names = add_arrays(object.layout, arrays, sections);
            const char* const comma = i > 0 ? "," : "";
            numbers += fmt::format("{}{}", comma, i);
            nodes += comma + node_of(object, i);
            meshes += fmt::format(
                R"({}{{"primitives":[{{"attributes":{{{}}},"indices":{},"material":{},"mode":4}}]}})",
                comma, names, arrays.count - 1, i);
            // Colours of vertices are multiplied by the material's.
            materials += comma + material_of(object.title,
                                             colors() ? LabelColor{255, 255, 255} : object.color);
        }
        std::string json =
            R"({"asset":{"version":"2.0","generator":"isonest"},"scene":0,"scenes":[{)";
        if (!objects_.empty()) {
            json += fmt::format(
                R"("nodes":[{}]}}],"nodes":[{}],"meshes":[{}],"materials":[{}],"buffers":[{{)"
                R"("byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}})",
                numbers, nodes, meshes, materials, arrays.end, arrays.views, arrays.accessors);
        } else {
            // glTF does not allow an empty mesh. VTK rejects a scene without nodes and a file
            // without binary data.
            arrays.end = 4;
            json += R"("nodes":[0]}],"nodes":[{"name":"empty"}],"buffers":[{"byteLength":4}]})";
        }
        json.resize(padded(json.size()), ' ');
        head_ = 12 + 8 + json.size() + 8;
        const std::uint64_t total = head_ + arrays.end;
        require_bits(32, total, "bytes of mesh", "glTF binary");
        const OutputFile& out = create();
        std::vector<std::uint32_t> words{0x46546C67, 2, static_cast<std::uint32_t>(total),
                                         static_cast<std::uint32_t>(json.size()), 0x4E4F534A};
        out.write_at(0, std::as_bytes(std::span(words)));
        out.write_at(20, std::as_bytes(std::span(json)));
        words = {static_cast<std::uint32_t>(arrays.end), 0x004E4942};
        if (objects_.empty()) {
            words.push_back(0);
        }
        out.write_at(20 + json.size(), std::as_bytes(std::span(words)));
    }

    /// Objects come in their order, so that their places follow from those before them.
    void begin_object(std::size_t object) override {
        const MeshLayout& layout = objects_[object].layout;
        Sections sections;
        add_arrays(layout, placed_, sections);
        placed_.views.clear();
        placed_.accessors.clear();
        sections.shift(head_);
        use(std::move(sections), layout);
    }

  protected:
    [[nodiscard]] bool holds_colors() const override { return true; }
    [[nodiscard]] bool holds_fields() const override { return true; }

  private:
    /// The node of object number `mesh`.
    [[nodiscard]] std::string node_of(const FileObject& object, std::size_t mesh) const {
        return fmt::format(
            R"({{"mesh":{}{}{}{}{}}})", mesh,
            object.title.empty() ? "" : fmt::format(R"(,"name":{})", json_string(object.title)),
            // A quarter turn about x takes z up to y.
            is_y_up() ? R"(,"rotation":[-0.70710678118654752,0,0,0.70710678118654752])" : "",
            scale_of(object.layout.unit),
            object.layout.frame == AnatomicalFrame::unknown
                ? ""
                : fmt::format(R"(,"extras":{{"SPACE":"{}"}})", name_of(object.layout.frame)));
    }

    /// The names of the attributes with the numbers of their accessors.
    std::string add_arrays(const MeshLayout& layout, Arrays& arrays, Sections& sections) const {
        constexpr int kFloat = 5126;
        constexpr int kUshort = 5123;
        constexpr int kUint = 5125;
        constexpr int kVertices = 34962;
        constexpr int kIndices = 34963;
        const std::uint64_t nv = layout.vertices;
        const std::uint64_t nt = layout.elements;
        const auto& lo = layout.lo;
        const auto& hi = layout.hi;
        std::string names = fmt::format("\"POSITION\":{}", arrays.count);
        sections.vertices.push_back(position_section(
            arrays.add(nv * 12, nv, kFloat, "VEC3", kVertices,
                       fmt::format(",\"min\":[{:.9g},{:.9g},{:.9g}],\"max\":[{:.9g},{:.9g},{:.9g}]",
                                   lo[0], lo[1], lo[2], hi[0], hi[1], hi[2]))));
        for (const VertexAttribute& a : layout.attributes) {
            names += fmt::format(",\"{}\":{}", semantic_of(a), arrays.count);
            sections.vertices.push_back(
                attribute_section(arrays.add(nv * a.bytes(), nv, kFloat,
                                             a.components == 3 ? "VEC3" : "SCALAR", kVertices),
                                  a));
        }
        if (colors()) {
            names += fmt::format(",\"COLOR_0\":{}", arrays.count);
            const ColorScale scale = color_scale(*colors(), layout, ColorForm::linear16);
            sections.vertices.push_back(
                color_section(arrays.add(nv * scale.bytes(), nv, kUshort, "VEC4", kVertices,
                                         ",\"normalized\":true"),
                              scale));
        }
        sections.elements.push_back(
            indices32_section(arrays.add(nt * 12, nt * 3, kUint, "SCALAR", kIndices)));
        return names;
    }

    std::vector<FileObject> objects_;
    std::uint64_t head_ = 0;  ///< bytes before the arrays
    Arrays placed_;           ///< those of the objects so far
};

}  // namespace

std::unique_ptr<MeshSink> glb_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<GlbFile>(path, o);
}

// Neuroglancer's single-resolution mesh: the number of vertices (uint32), their positions
// (float32), and three numbers (uint32) for each triangle. Positions are in nanometres, unless
// their unit is unknown. The format:
// https://github.com/google/neuroglancer/blob/master/src/datasource/precomputed/meshes.md

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
