#include "tools/python/src/array_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include <isonest/error.h>

namespace isonest::python {
namespace {

using Position = std::array<float, 3>;

/// The same attributes with those of float64 as float32.
MeshLayout in_float32(MeshLayout layout) {
    layout.row_bytes = 0;
    for (VertexAttribute& attribute : layout.attributes) {
        attribute.is_double = false;
        attribute.offset = layout.row_bytes;
        layout.row_bytes += attribute.bytes();
    }
    return layout;
}

/// A mesh's rows as batches have them.
class Rows {
  public:
    Rows(const ArrayMesh& mesh, const MeshLayout& layout, const std::filesystem::path& path)
        : mesh_(mesh), layout_(layout), path_(path) {}

    void clear() {
        positions_.clear();
        attributes_.clear();
    }
    void add(std::size_t vertex) {
        const float* const p = mesh_.positions + 3 * vertex;
        positions_.push_back({p[0], p[1], p[2]});
        attributes_.resize(attributes_.size() + layout_.row_bytes);
        std::byte* const row = attributes_.data() + attributes_.size() - layout_.row_bytes;
        for (const VertexAttribute& attribute : layout_.attributes) {
            put(attribute, vertex, row + attribute.offset);
        }
    }
    [[nodiscard]] VertexBatch batch(std::size_t first) const {
        return {first, positions_, attributes_, layout_.row_bytes};
    }

  private:
    void put(const VertexAttribute& attribute, std::size_t vertex, std::byte* to) const {
        if (attribute.name == "normal") {
            std::memcpy(to, mesh_.normals + 3 * vertex, attribute.bytes());
        } else if (attribute.name == "error") {
            std::memcpy(to, mesh_.errors + vertex, attribute.bytes());
        } else if (attribute.is_double) {
            std::memcpy(to, mesh_.values + vertex, attribute.bytes());
        } else {
            const double value = mesh_.values[vertex];
            if (std::fabs(value) > static_cast<double>(std::numeric_limits<float>::max())) {
                throw Error(ErrorKind::limit, {path_.string()},
                            "the format has 32-bit floats, and values are beyond them",
                            {{RemedyKind::other_format, ".ply, .vtp, .vtkhdf"}});
            }
            const auto rounded = static_cast<float>(value);
            std::memcpy(to, &rounded, attribute.bytes());
        }
    }

    const ArrayMesh& mesh_;
    const MeshLayout& layout_;
    const std::filesystem::path& path_;
    std::vector<Position> positions_;
    std::vector<std::byte> attributes_;
};

void send_vertices(const ArrayMesh& mesh, Rows& rows, MeshSink& sink, Progress& progress) {
    for (std::size_t at = 0; at < mesh.vertices; at += MeshSink::kMostRows) {
        progress.check();
        rows.clear();
        for (std::size_t i = at; i < std::min(mesh.vertices, at + MeshSink::kMostRows); ++i) {
            rows.add(i);
        }
        sink.add_vertices(rows.batch(at));
    }
}

/// The vertices of the element number i; of a line the last one twice.
std::array<std::uint64_t, 3> corners_of(const ArrayMesh& mesh, std::size_t count, std::size_t i) {
    const std::uint32_t* const c = mesh.corners + count * i;
    std::array<std::uint64_t, 3> corners{};
    for (std::size_t k = 0; k < corners.size(); ++k) {
        const std::size_t forward = std::min(k, count - 1);
        corners.at(k) = c[mesh.flip ? count - 1 - forward : forward];
        if (corners.at(k) >= mesh.vertices) {
            throw Error(ErrorKind::invalid_argument, "a face has a corner that is no vertex");
        }
    }
    return corners;
}

void send_elements(const ArrayMesh& mesh, std::size_t corners, Rows& rows, MeshSink& sink,
                   Progress& progress) {
    std::vector<std::array<std::uint64_t, 3>> numbers;
    std::vector<std::array<std::uint32_t, 3>> nearby;
    for (std::size_t at = 0; at < mesh.elements; at += MeshSink::kMostRows) {
        progress.check();
        rows.clear();
        numbers.clear();
        nearby.clear();
        for (std::size_t i = at; i < std::min(mesh.elements, at + MeshSink::kMostRows); ++i) {
            numbers.push_back(corners_of(mesh, corners, i));
            const auto first = static_cast<std::uint32_t>(3 * (i - at));
            nearby.push_back({first, first + 1, first + 2});
            for (const std::uint64_t vertex : numbers.back()) {
                rows.add(static_cast<std::size_t>(vertex));
            }
        }
        ElementBatch batch{at, numbers, nearby, rows.batch(0)};
        if (mesh.sides != nullptr) {
            batch.sides = {mesh.sides + at, numbers.size()};
        }
        sink.add_elements(batch);
        progress.advance(numbers.size());
    }
}

}  // namespace

void write_mesh(const ArrayMesh& mesh, const MeshOrigin& origin, const std::filesystem::path& path,
                MeshSink& sink, Progress& progress) {
    MeshLayout layout = sink.holds_float64() ? origin.layout : in_float32(origin.layout);
    layout.vertices = mesh.vertices;
    layout.elements = mesh.elements;
    sink.prepare(layout, origin.inputs);
    sink.begin(layout);
    Rows rows(mesh, layout, path);
    do {
        progress.begin("write mesh", mesh.elements, "triangles");
        send_vertices(mesh, rows, sink, progress);
        send_elements(mesh, static_cast<std::size_t>(layout.corners), rows, sink, progress);
    } while (sink.again());
    sink.end();
}

}  // namespace isonest::python
