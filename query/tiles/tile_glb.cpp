// glTF 2.0: Khronos Group, "glTF 2.0 Specification" (2021). Extensions:
// https://github.com/KhronosGroup/glTF/tree/main/extensions (KHR_mesh_quantization,
// EXT_meshopt_compression) and https://github.com/CesiumGS/glTF/tree/3d-tiles-next
// (EXT_mesh_features, EXT_structural_metadata).
#include "query/tiles/tile_glb.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>

#include "query/formats/mesh_files.h"
#include "store/base/json_text.h"

#if ISONEST_WITH_MESHOPTIMIZER
#include <meshoptimizer.h>
#endif

namespace isonest::detail {

namespace {

constexpr int kByte = 5120;
constexpr int kUnsignedShort = 5123;
constexpr int kUnsignedInt = 5125;
constexpr int kFloat = 5126;

constexpr int kVertices = 34962;  // targets of buffer views
constexpr int kIndices = 34963;

#if ISONEST_WITH_MESHOPTIMIZER
/// EXT_meshopt_compression has one version of each codec (headers 0xa0 and 0xe1), whatever the
/// library's defaults are. They are set once, because they are the library's global state.
void choose_codecs() {
    static const bool chosen = [] {
        ::meshopt_encodeVertexVersion(0);
        ::meshopt_encodeIndexVersion(1);
        return true;
    }();
    static_cast<void>(chosen);
}
#endif

/// The binary part of a file, and the descriptions of its views and accessors.
class TileBuffer {
  public:
    /// Rows of vertices. `accessor`: its component type, type and further members.
    template <class Row>
    int add_rows(const std::vector<Row>& rows, const std::string& accessor) {
        static_assert(sizeof(Row) % 4 == 0);
        std::string packed;
#if ISONEST_WITH_MESHOPTIMIZER
        packed.resize(::meshopt_encodeVertexBufferBound(rows.size(), sizeof(Row)));
        packed.resize(::meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(packed.data()),
                                                   packed.size(), rows.data(), rows.size(),
                                                   sizeof(Row)));
#endif
        add_view(bytes_of(rows), packed,
                 fmt::format(R"(,"byteStride":{},"target":{})", sizeof(Row), kVertices),
                 sizeof(Row), rows.size(), "ATTRIBUTES");
        return add_accessor(rows.size(), accessor);
    }
    int add_indices(const std::vector<std::uint32_t>& indices, std::size_t vertices) {
        const bool narrow = vertices <= std::numeric_limits<std::uint16_t>::max();
        std::string packed;
#if ISONEST_WITH_MESHOPTIMIZER
        packed.resize(::meshopt_encodeIndexBufferBound(indices.size(), vertices));
        packed.resize(::meshopt_encodeIndexBuffer(reinterpret_cast<unsigned char*>(packed.data()),
                                                  packed.size(), indices.data(), indices.size()));
#else
        static_cast<void>(vertices);
#endif
        const std::vector<std::uint16_t> narrow_indices(indices.begin(), indices.end());
        add_view(narrow ? bytes_of(narrow_indices) : bytes_of(indices), packed,
                 fmt::format(R"(,"target":{})", kIndices), narrow ? 2 : 4, indices.size(),
                 "TRIANGLES");
        return add_accessor(indices.size(), fmt::format(R"("componentType":{},"type":"SCALAR")",
                                                        narrow ? kUnsignedShort : kUnsignedInt));
    }
    /// Bytes of a property table, which start at multiples of 8 and are not packed.
    int add_plain(const std::string& bytes) {
        add_view(bytes, {}, "", 1, bytes.size(), nullptr);
        return views_count_ - 1;
    }

    [[nodiscard]] const std::string& views() const {
        return views_;
    }
    [[nodiscard]] const std::string& accessors() const {
        return accessors_;
    }
    [[nodiscard]] const std::string& bytes() const {
        return bytes_;
    }
    /// The buffers: the binary part and, if views are packed, what they are unpacked to.
    [[nodiscard]] std::string buffers() const {
        std::string text = fmt::format(R"({{"byteLength":{}}})", bytes_.size());
        if (unpacked_ > 0) {
            text += fmt::format(R"(,{{"byteLength":{},"extensions":{{"EXT_meshopt_compression":)"
                                R"({{"fallback":true}}}}}})",
                                unpacked_);
        }
        return text;
    }
    [[nodiscard]] bool is_packed() const {
        return unpacked_ > 0;
    }

  private:
    template <class T>
    static std::string bytes_of(const std::vector<T>& rows) {
        return {reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(T)};
    }
    /// `mode`: of the packed bytes, unused if they are empty.
    void add_view(const std::string& plain, const std::string& packed, const std::string& members,
                  std::size_t stride, std::size_t count, const char* mode) {
        const std::string& stored = packed.empty() ? plain : packed;
        const std::size_t at = bytes_.size();
        bytes_ += stored;
        bytes_.resize((bytes_.size() + 7) / 8 * 8, '\0');
        const char* const comma = views_.empty() ? "" : ",";
        if (packed.empty()) {
            views_ += fmt::format(R"({}{{"buffer":0,"byteOffset":{},"byteLength":{}{}}})", comma,
                                  at, stored.size(), members);
        } else {
            views_ += fmt::format(
                R"({}{{"buffer":1,"byteOffset":{},"byteLength":{}{},"extensions":)"
                R"({{"EXT_meshopt_compression":{{"buffer":0,"byteOffset":{},"byteLength":{},)"
                R"("byteStride":{},"mode":"{}","count":{}}}}}}})",
                comma, unpacked_, plain.size(), members, at, stored.size(), stride, mode, count);
            unpacked_ += (plain.size() + 7) / 8 * 8;
        }
        ++views_count_;
    }
    int add_accessor(std::size_t count, const std::string& members) {
        accessors_ += fmt::format(R"({}{{"bufferView":{},"count":{},{}}})",
                                  accessors_.empty() ? "" : ",", views_count_ - 1, count, members);
        return accessors_count_++;
    }
    std::string bytes_;
    std::string views_;
    std::string accessors_;
    int views_count_ = 0;
    int accessors_count_ = 0;
    std::size_t unpacked_ = 0;
};

/// Vertices and triangles in an order that is packed well and drawn fast.
TileMesh ordered(const TileMesh& mesh) {
#if ISONEST_WITH_MESHOPTIMIZER
    TileMesh to;
    std::vector<std::uint32_t> indices;
    for (const auto& t : mesh.triangles) {
        indices.insert(indices.end(), t.begin(), t.end());
    }
    ::meshopt_optimizeVertexCache(indices.data(), indices.data(), indices.size(),
                                  mesh.vertices.size());
    std::vector<std::uint32_t> number(mesh.vertices.size());
    to.vertices.resize(::meshopt_optimizeVertexFetchRemap(number.data(), indices.data(),
                                                          indices.size(), mesh.vertices.size()));
    for (std::size_t v = 0; v < number.size(); ++v) {
        if (number[v] < to.vertices.size()) {
            to.vertices[number[v]] = mesh.vertices[v];
        }
    }
    for (std::size_t i = 0; i < indices.size(); i += 3) {
        to.triangles.push_back(
            {number[indices[i]], number[indices[i + 1]], number[indices[i + 2]]});
    }
    return to;
#else
    return mesh;
#endif
}

using Color16 = std::array<std::uint16_t, 4>;

Color16 linear16(const std::array<double, 3>& linear) {
    constexpr std::uint16_t kOne = std::numeric_limits<std::uint16_t>::max();
    Color16 color{0, 0, 0, kOne};
    for (std::size_t i = 0; i < 3; ++i) {
        color[i] = static_cast<std::uint16_t>(std::lround(linear[i] * kOne));
    }
    return color;
}

std::array<double, 3> linear_color(const LabelColor& shown) {
    return {linear_of(shown[0]), linear_of(shown[1]), linear_of(shown[2])};
}

Color16 color_of(const VertexColors& colors, double value) {
    return linear16(color_between(colors.low, colors.high, value, [&colors](std::size_t i) {
        return linear_color(colors.map[i]);
    }));
}

template <class T>
void append(std::string& bytes, T number) {
    const std::size_t at = bytes.size();
    bytes.resize(at + sizeof(T));
    std::memcpy(bytes.data() + at, &number, sizeof(T));
}

/// The table of a tile's features, as the extension EXT_structural_metadata.
std::string feature_table(std::span<const TileFeature> all, const std::vector<std::uint32_t>& here,
                          TileBuffer& buffer) {
    std::string labels;
    std::string isovalues;
    std::string names;
    std::string offsets;
    const bool is_wide = std::any_of(all.begin(), all.end(), [](const TileFeature& f) {
        return f.label && static_cast<std::int32_t>(*f.label) != *f.label;
    });
    for (const std::uint32_t i : here) {
        const TileFeature& feature = all[i];
        if (is_wide) {
            append(labels, feature.label.value_or(0));
        } else {
            append(labels, static_cast<std::int32_t>(feature.label.value_or(0)));
        }
        append(isovalues, feature.isovalue.value_or(0));
        append(offsets, static_cast<std::uint32_t>(names.size()));
        names += feature.name;
    }
    append(offsets, static_cast<std::uint32_t>(names.size()));
    std::string described;
    std::string stored;
    const auto add = [&](const char* name, const std::string& type, const std::string& values) {
        const char* const comma = described.empty() ? "" : ",";
        described += fmt::format(R"({}"{}":{{{}}})", comma, name, type);
        stored += fmt::format(R"({}"{}":{{{}}})", comma, name, values);
    };
    if (all.front().label) {
        add("label",
            fmt::format(R"("type":"SCALAR","componentType":"{}","required":true)",
                        is_wide ? "INT64" : "INT32"),
            fmt::format(R"("values":{})", buffer.add_plain(labels)));
    }
    if (all.front().isovalue) {
        add("isovalue", R"("type":"SCALAR","componentType":"FLOAT64","required":true)",
            fmt::format(R"("values":{})", buffer.add_plain(isovalues)));
    }
    if (!names.empty()) {
        add("name", R"("type":"STRING","required":true)",
            fmt::format(R"("values":{},"stringOffsets":{})", buffer.add_plain(names),
                        buffer.add_plain(offsets)));
    }
    return fmt::format(
        R"("EXT_structural_metadata":{{"schema":{{"id":"isonest","classes":{{"surface":)"
        R"({{"properties":{{{}}}}}}}}},"propertyTables":[{{"class":"surface","count":{},)"
        R"("properties":{{{}}}}}]}})",
        described, here.size(), stored);
}

/// A surface has no inside: it is visible from both sides.
std::string material_of(const TileStyle& style, bool has_colors) {
    constexpr LabelColor kWhite{255, 255, 255};
    std::string color = "0.62,0.68,0.76";
    if (style.color || has_colors) {
        const auto linear = linear_color(has_colors ? kWhite : *style.color);
        color = fmt::format("{:.6f},{:.6f},{:.6f}", linear[0], linear[1], linear[2]);
    }
    return fmt::format(
        R"({{"name":{},"doubleSided":true,"pbrMetallicRoughness":{{"baseColorFactor":[{},1],)"
        R"("metallicFactor":0,"roughnessFactor":0.7}}}})",
        json_string(style.title.empty() ? "surface" : style.title), color);
}

}  // namespace

std::string tile_glb(const TileMesh& unordered, const Double3& low, const Double3& step,
                     const TileStyle& style) {
#if ISONEST_WITH_MESHOPTIMIZER
    choose_codecs();
#endif
    const TileMesh mesh = ordered(unordered);
    TileBuffer buffer;
    std::vector<std::array<std::uint16_t, 4>> positions;
    std::vector<std::array<std::int8_t, 4>> normals;
    std::vector<float> values;
    std::vector<Color16> colors;
    std::vector<std::array<std::uint16_t, 2>> features;
    std::array<std::array<std::int32_t, 3>, 2> box{mesh.vertices.front().at,
                                                   mesh.vertices.front().at};
    std::vector<std::uint32_t> here;  // features of this tile, ascending
    for (const TileMesh::Vertex& v : mesh.vertices) {
        here.push_back(v.feature);
    }
    std::sort(here.begin(), here.end());
    here.erase(std::unique(here.begin(), here.end()), here.end());
    const bool has_features = style.features.size() > 1;
    const bool colors_features =
        !style.colors && std::any_of(style.features.begin(), style.features.end(),
                                     [](const TileFeature& f) { return f.color.has_value(); });
    constexpr std::array<double, 3> kPlain{0.62, 0.68, 0.76};
    bool has_normals = false;
    for (const TileMesh::Vertex& v : mesh.vertices) {
        std::array<std::uint16_t, 4> at{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            box[0][axis] = std::min(box[0][axis], v.at[axis]);
            box[1][axis] = std::max(box[1][axis], v.at[axis]);
            at[axis] = static_cast<std::uint16_t>(v.at[axis]);
        }
        positions.push_back(at);
        normals.push_back({v.normal[0], v.normal[1], v.normal[2], 0});
        has_normals = has_normals || v.normal != std::array<std::int8_t, 3>{};
        values.push_back(v.value);
        if (style.colors) {
            colors.push_back(color_of(*style.colors, static_cast<double>(v.value)));
        } else if (colors_features) {
            const auto& color = style.features[v.feature].color;
            colors.push_back(linear16(color ? linear_color(*color) : kPlain));
        }
        const auto place = std::lower_bound(here.begin(), here.end(), v.feature) - here.begin();
        features.push_back({static_cast<std::uint16_t>(place), 0});
    }
    std::string attributes = fmt::format(
        R"("POSITION":{})",
        buffer.add_rows(positions,
                        fmt::format(R"("componentType":{},"type":"VEC3","min":[{},{},{}],)"
                                    R"("max":[{},{},{}])",
                                    kUnsignedShort, box[0][0], box[0][1], box[0][2], box[1][0],
                                    box[1][1], box[1][2])));
    if (has_normals) {
        attributes += fmt::format(
            R"(,"NORMAL":{})",
            buffer.add_rows(
                normals,
                fmt::format(R"("componentType":{},"normalized":true,"type":"VEC3")", kByte)));
    }
    if (!colors.empty()) {
        attributes += fmt::format(
            R"(,"COLOR_0":{})",
            buffer.add_rows(colors,
                            fmt::format(R"("componentType":{},"normalized":true,"type":"VEC4")",
                                        kUnsignedShort)));
    }
    if (!style.value.empty()) {
        attributes += fmt::format(
            R"(,"{}":{})", style.value,
            buffer.add_rows(values, fmt::format(R"("componentType":{},"type":"SCALAR")", kFloat)));
    }
    std::string primitive_extensions;
    std::string file_extensions;
    std::string used = R"("KHR_mesh_quantization")";
    std::string required = used;
    if (has_features) {
        attributes += fmt::format(
            R"(,"_FEATURE_ID_0":{})",
            buffer.add_rows(features,
                            fmt::format(R"("componentType":{},"type":"SCALAR")", kUnsignedShort)));
        primitive_extensions = fmt::format(
            R"(,"extensions":{{"EXT_mesh_features":{{"featureIds":[{{"featureCount":{},)"
            R"("attribute":0,"propertyTable":0,"label":"surface"}}]}}}})",
            here.size());
        file_extensions =
            fmt::format(R"("extensions":{{{}}},)", feature_table(style.features, here, buffer));
        used += R"(,"EXT_mesh_features","EXT_structural_metadata")";
    }
    std::vector<std::uint32_t> indices;
    for (const auto& t : mesh.triangles) {
        indices.insert(indices.end(), t.begin(), t.end());
    }
    const int index_accessor = buffer.add_indices(indices, mesh.vertices.size());
    if (buffer.is_packed()) {
        used += R"(,"EXT_meshopt_compression")";
        required += R"(,"EXT_meshopt_compression")";
    }
    // (x, y, z) becomes (x, z, -y).
    std::string json = fmt::format(
        R"({{"asset":{{"version":"2.0","generator":"isonest"}},"extensionsUsed":[{}],)"
        R"("extensionsRequired":[{}],{}"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,)"
        R"("rotation":[-0.7071067811865476,0,0,0.7071067811865476],"translation":[{},{},{}],)"
        R"("scale":[{},{},{}]}}],"materials":[{}],"meshes":[{{"primitives":[{{"attributes":{{{}}},)"
        R"("indices":{},"material":0{}}}]}}],"accessors":[{}],"bufferViews":[{}],)"
        R"("buffers":[{}]}})",
        used, required, file_extensions, low[0] * style.metres, low[2] * style.metres,
        -low[1] * style.metres, step[0] * style.metres, step[1] * style.metres,
        step[2] * style.metres, material_of(style, !colors.empty()), attributes, index_accessor,
        primitive_extensions, buffer.accessors(), buffer.views(), buffer.buffers());
    // Both chunks start at multiples of 8, which tables of features need.
    constexpr std::size_t kHead = 12 + 8 + 8;
    json.resize((json.size() + kHead + 7) / 8 * 8 - kHead, ' ');
    std::string file = "glTF";
    append(file, std::uint32_t{2});
    append(file, static_cast<std::uint32_t>(kHead + json.size() + buffer.bytes().size()));
    append(file, static_cast<std::uint32_t>(json.size()));
    file += "JSON" + json;
    append(file, static_cast<std::uint32_t>(buffer.bytes().size()));
    file += std::string("BIN\0", 4) + buffer.bytes();
    return file;
}

}  // namespace isonest::detail
