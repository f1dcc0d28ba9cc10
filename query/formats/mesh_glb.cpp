// glTF 2.0 binary (GLB). The format: Khronos Group, "glTF 2.0 Specification" (2021).
#include <fmt/format.h>

#include <cmath>

#include "query/formats/mesh_sections.h"

namespace isonest::detail {
namespace {

std::uint64_t padded(std::uint64_t bytes) {
    return (bytes + 3) / 4 * 4;
}

/// glTF's own name, or one of ours, which has to begin with an underscore.
std::string semantic_of(const std::string& name) {
    return name == "normal"  ? "NORMAL"
           : name == "value" ? "_VALUE"
           : name == "error" ? "_ERROR"
                             : "_ISOVALUE";
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

/// glTF's unit is the metre. The coordinates stay what they are, and the node scales them, unless
/// their unit is not known.
std::string scale_of(std::optional<LengthUnit> unit) {
    return !unit || *unit == LengthUnit::metre
               ? ""
               : fmt::format(R"(,"scale":[{0},{0},{0}])",
                             converted_length(1, *unit, LengthUnit::metre));
}

/// Between quotes. REQUIRES: no control characters.
std::string in_json(std::string_view text) {
    std::string out;
    for (const char c : text) {
        out += c == '"' || c == '\\' ? std::string{'\\', c} : std::string{c};
    }
    return out;
}

/// Of a number from 0 to 255 that screens show: glTF's colours are linear. Source: IEC 61966-2-1.
double linear_of(std::uint8_t shown) {
    constexpr double kMost = 255;
    const double part = shown / kMost;
    return part <= 0.04045 ? part / 12.92 : std::pow((part + 0.055) / 1.055, 2.4);
}

/// A surface has no inside: it is seen from both sides. Viewers draw what says nothing of itself as
/// metal.
std::string material_of(const std::string& title, const std::optional<LabelColor>& color) {
    return fmt::format(
        R"({{"name":"{}","doubleSided":true,"pbrMetallicRoughness":{{"baseColorFactor":)"
        R"([{},1],"metallicFactor":0,"roughnessFactor":0.7}}}})",
        title.empty() ? "surface" : in_json(title),
        color ? fmt::format("{:.6f},{:.6f},{:.6f}", linear_of((*color)[0]), linear_of((*color)[1]),
                            linear_of((*color)[2]))
              : std::string("0.62,0.68,0.76"));
}

class GlbFile : public SectionedFile {
  public:
    using SectionedFile::SectionedFile;
    [[nodiscard]] bool holds_float64() const override { return false; }
    void begin_file(const MeshLayout& layout) override {
        require_bits(32, layout.vertices, "vertices", "glTF");
        Arrays arrays;
        Sections sections;
        const std::string names = layout.elements > 0 ? add_arrays(layout, arrays, sections) : "";
        std::string json =
            R"({"asset":{"version":"2.0","generator":"isonest"},"scene":0,"scenes":[{)";
        if (layout.elements > 0) {
            json += fmt::format(
                "\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0{}{}{}}}],\"meshes\":[{{\"primitives\":[{{"
                "\"attributes\":{{{}}},\"indices\":{},\"material\":0,\"mode\":4}}]}}],"
                "\"materials\":[{}],\"buffers\":[{{"
                "\"byteLength\":{}}}],\"bufferViews\":[{}],\"accessors\":[{}]}}",
                title().empty() ? "" : fmt::format(R"(,"name":"{}")", in_json(title())),
                scale_of(layout.unit),
                layout.frame == AnatomicalFrame::unknown
                    ? ""
                    : fmt::format(R"(,"extras":{{"SPACE":"{}"}})", name_of(layout.frame)),
                names, arrays.count - 1, material_of(title(), color()), arrays.end, arrays.views,
                arrays.accessors);
        } else {
            // glTF has no empty mesh. VTK refuses a scene without nodes and a file without binary
            // data.
            arrays.end = 4;
            json += R"("nodes":[0]}],"nodes":[{"name":"empty"}],"buffers":[{"byteLength":4}]})";
        }
        json.resize(padded(json.size()), ' ');
        const std::uint64_t head = 12 + 8 + json.size() + 8;
        const std::uint64_t total = head + arrays.end;
        require_bits(32, total, "bytes of mesh", "glTF binary");
        const OutputFile& out = create();
        std::vector<std::uint32_t> words{0x46546C67, 2, static_cast<std::uint32_t>(total),
                                         static_cast<std::uint32_t>(json.size()), 0x4E4F534A};
        out.write_at(0, std::as_bytes(std::span(words)));
        out.write_at(20, std::as_bytes(std::span(json)));
        words = {static_cast<std::uint32_t>(arrays.end), 0x004E4942};
        if (layout.elements == 0) {
            words.push_back(0);
        }
        out.write_at(20 + json.size(), std::as_bytes(std::span(words)));
        sections.shift(head);
        use(std::move(sections), layout);
    }

  private:
    /// The names of the attributes with their accessors' numbers.
    static std::string add_arrays(const MeshLayout& layout, Arrays& arrays, Sections& sections) {
        constexpr int kFloat = 5126;
        constexpr int kUint = 5125;
        constexpr int kVertices = 34962;
        constexpr int kIndices = 34963;
        const std::uint64_t nv = layout.vertices;
        const std::uint64_t nt = layout.elements;
        const auto& lo = layout.lo;
        const auto& hi = layout.hi;
        std::string names = "\"POSITION\":0";
        sections.vertices.push_back(position_section(
            arrays.add(nv * 12, nv, kFloat, "VEC3", kVertices,
                       fmt::format(",\"min\":[{:.9g},{:.9g},{:.9g}],\"max\":[{:.9g},{:.9g},{:.9g}]",
                                   lo[0], lo[1], lo[2], hi[0], hi[1], hi[2]))));
        for (const VertexAttribute& a : layout.attributes) {
            names += fmt::format(",\"{}\":{}", semantic_of(a.name), arrays.count);
            sections.vertices.push_back(
                attribute_section(arrays.add(nv * a.bytes(), nv, kFloat,
                                             a.components == 3 ? "VEC3" : "SCALAR", kVertices),
                                  a));
        }
        sections.elements.push_back(
            indices32_section(arrays.add(nt * 12, nt * 3, kUint, "SCALAR", kIndices)));
        return names;
    }
};

}  // namespace

std::unique_ptr<MeshSink> glb_file(const std::filesystem::path& path, const MeshFileOptions& o) {
    return std::make_unique<GlbFile>(path, o);
}

}  // namespace isonest::detail
