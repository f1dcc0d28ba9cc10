// glTF 2.0 binary (GLB). The format: Khronos Group, "glTF 2.0 Specification" (2021).
#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "query/mesh/mesh_sections.h"

namespace isonest::detail {
namespace {

std::uint64_t padded(std::uint64_t bytes) {
    return (bytes + 3) / 4 * 4;
}

struct Bounds {
    std::array<float, 3> lo;
    std::array<float, 3> hi;
};

Bounds bounds_of(const MeshContent& mesh) {
    constexpr float kMost = std::numeric_limits<float>::max();
    Bounds b{{kMost, kMost, kMost}, {-kMost, -kMost, -kMost}};
    for (const PartRecord& r : mesh.parts.records()) {
        for (const auto& p : mesh.parts.vertices(r)) {
            for (std::size_t a = 0; a < 3; ++a) {
                b.lo[a] = std::min(b.lo[a], p[a]);
                b.hi[a] = std::max(b.hi[a], p[a]);
            }
        }
    }
    return b;
}

/// glTF's own name, or one of ours, which has to begin with an underscore.
std::string semantic_of(const std::string& name) {
    return name == "normal" ? "NORMAL" : name == "value" ? "_VALUE" : "_ERROR";
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

}  // namespace

void write_glb(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress) {
    constexpr int kFloat = 5126;
    constexpr int kUint = 5125;
    constexpr int kVertices = 34962;
    constexpr int kIndices = 34963;
    require_32_bits(path, mesh.weld.vertices(), "vertices", "glTF");
    const std::uint64_t nv = mesh.weld.vertices();
    const std::uint64_t nt = mesh.weld.triangles();
    Arrays arrays;
    std::vector<VertexSection> vertices;
    std::vector<TriangleSection> triangles;
    std::string names = "\"POSITION\":0";
    if (nt > 0) {
        const Bounds b = bounds_of(mesh);
        vertices.push_back(position_section(
            arrays.add(nv * 12, nv, kFloat, "VEC3", kVertices,
                       fmt::format(",\"min\":[{:.9g},{:.9g},{:.9g}],\"max\":[{:.9g},{:.9g},{:.9g}]",
                                   b.lo[0], b.lo[1], b.lo[2], b.hi[0], b.hi[1], b.hi[2]))));
        for (const AttributeChoice::Array& array : mesh.attributes.arrays()) {
            names += fmt::format(",\"{}\":{}", semantic_of(array.name), arrays.count);
            vertices.push_back(
                attribute_section(arrays.add(nv * array.bytes(), nv, kFloat,
                                             array.components == 3 ? "VEC3" : "SCALAR", kVertices),
                                  array));
        }
        triangles.push_back({arrays.add(nt * 12, nt * 3, kUint, "SCALAR", kIndices), 12,
                             [](const TriangleRow& t, std::byte* out) { put_indices32(t, out); }});
    }
    std::string json = R"({"asset":{"version":"2.0","generator":"isonest"},"scene":0,"scenes":[{)";
    if (nt > 0) {
        json += fmt::format(
            "\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0}}],\"meshes\":[{{\"primitives\":[{{"
            "\"attributes\":{{{}}},\"indices\":{},\"mode\":4}}]}}],\"buffers\":[{{"
            "\"byteLength\":{}}}],\"bufferViews\":[{}],\"accessors\":[{}]}}",
            names, arrays.count - 1, arrays.end, arrays.views, arrays.accessors);
    } else {
        // glTF has no empty mesh. VTK refuses a scene without nodes and a file without binary data.
        arrays.end = 4;
        json += R"("nodes":[0]}],"nodes":[{"name":"empty"}],"buffers":[{"byteLength":4}]})";
    }
    json.resize(padded(json.size()), ' ');
    const std::uint64_t head = 12 + 8 + json.size() + 8;
    const std::uint64_t total = head + arrays.end;
    require_32_bits(path, total, "bytes of mesh", "glTF binary");
    OutputFile file(path, force);
    std::vector<std::uint32_t> words{0x46546C67, 2, static_cast<std::uint32_t>(total),
                                     static_cast<std::uint32_t>(json.size()), 0x4E4F534A};
    file.write_at(0, std::as_bytes(std::span(words)));
    file.write_at(20, std::as_bytes(std::span(json)));
    words = {static_cast<std::uint32_t>(arrays.end), 0x004E4942};
    if (nt == 0) {
        words.push_back(0);
    }
    file.write_at(20 + json.size(), std::as_bytes(std::span(words)));
    shift(head, vertices, triangles);
    write_sections(file, mesh, vertices, triangles, progress);
    file.publish_as_named();
}

}  // namespace isonest::detail
