#include <fmt/format.h>

#include <cstring>
#include <limits>

#include <isonest/error.h>
#include <isonest/mesh_sink.h>

namespace isonest {
namespace {

template <class T>
T read(const std::byte* at) {
    T number{};
    std::memcpy(&number, at, sizeof(number));
    return number;
}

}  // namespace

const VertexAttribute* MeshLayout::find(std::string_view name) const {
    for (const VertexAttribute& attribute : attributes) {
        if (attribute.name == name) {
            return &attribute;
        }
    }
    return nullptr;
}

double VertexBatch::number(std::size_t i, const VertexAttribute& attribute, int component) const {
    const std::byte* const at = attributes.data() + i * row_bytes + attribute.offset;
    const auto c = static_cast<std::size_t>(component);
    return attribute.is_double ? read<double>(at + c * sizeof(double))
                               : static_cast<double>(read<float>(at + c * sizeof(float)));
}

void MeshCollector::begin(const MeshLayout& layout) {
    if (layout.vertices > std::numeric_limits<std::uint32_t>::max()) {
        throw Error(
            ErrorKind::limit,
            fmt::format("the mesh has {} vertices, more than 32 bits can number", layout.vertices),
            {{RemedyKind::smaller_box}, {RemedyKind::larger_error}});
    }
    layout_ = layout;
    const auto count = [](bool is_there, std::uint64_t n) {
        return is_there ? static_cast<std::size_t>(n) : 0;
    };
    vertices.assign(count(true, layout.vertices), {});
    triangles.assign(count(layout.corners == 3, layout.elements), {});
    lines.assign(count(layout.corners == 2, layout.elements), {});
    normals.assign(count(layout.find("normal") != nullptr, layout.vertices), {});
    values.assign(count(layout.find("value") != nullptr, layout.vertices), 0);
    errors.assign(count(layout.find("error") != nullptr, layout.vertices), 0);
    sides.assign(count(layout.has_sides, layout.elements), {});
}

void MeshCollector::add_vertices(const VertexBatch& batch) {
    const auto first = static_cast<std::size_t>(batch.first);
    std::copy(batch.positions.begin(), batch.positions.end(),
              vertices.begin() + static_cast<std::ptrdiff_t>(first));
    const std::size_t count = batch.positions.size();
    if (const VertexAttribute* const normal = layout_.find("normal")) {
        for (std::size_t i = 0; i < count; ++i) {
            for (int c = 0; c < 3; ++c) {
                normals[first + i][static_cast<std::size_t>(c)] =
                    static_cast<float>(batch.number(i, *normal, c));
            }
        }
    }
    if (const VertexAttribute* const value = layout_.find("value")) {
        for (std::size_t i = 0; i < count; ++i) {
            values[first + i] = batch.number(i, *value);
        }
    }
    if (const VertexAttribute* const error = layout_.find("error")) {
        for (std::size_t i = 0; i < count; ++i) {
            errors[first + i] = static_cast<float>(batch.number(i, *error));
        }
    }
}

void MeshCollector::add_elements(const ElementBatch& batch) {
    auto i = static_cast<std::size_t>(batch.first);
    if (layout_.has_sides) {
        std::copy(batch.sides.begin(), batch.sides.end(),
                  sides.begin() + static_cast<std::ptrdiff_t>(i));
    }
    for (const auto& [a, b, c] : batch.corners) {
        if (layout_.corners == 3) {
            triangles[i++] = {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b),
                              static_cast<std::uint32_t>(c)};
        } else {
            lines[i++] = {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b)};
        }
    }
}

void CallbackSink::add_vertices(const VertexBatch& batch) {
    if (on_vertices_) {
        on_vertices_(batch);
    }
}

void CallbackSink::add_elements(const ElementBatch& batch) {
    if (on_elements_) {
        on_elements_(batch);
    }
}

}  // namespace isonest
