// Meshes and images of slices as arrays of numbers, for programs that use the npm package (npm/).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>
#include <isonest/store.h>

#include "tools/view/http_messages.h"
#include "tools/view/mesh_request.h"
#include "tools/view/store_answers.h"

namespace isonest::detail::web {

/// The arrays of an answer. Those that it does not have are empty.
struct NumberArrays {
    std::vector<float> positions;        ///< x, y, z of each vertex, world coordinates
    std::vector<float> normals;          ///< x, y, z of each vertex
    std::vector<float> values;           ///< of each vertex, or of each pixel of an image
    std::vector<std::uint32_t> indices;  ///< vertices of each triangle (3) or line (2)

    static constexpr int kCount = 4;
    /// In this order: positions, normals, values, indices. REQUIRES: 0 <= which < kCount.
    [[nodiscard]] std::span<const std::byte> bytes(int which) const;
};

/// Collects a mesh.
class ArrayMesh : public MeshSink {
  public:
    /// `memory`: maximum number of bytes of the arrays. begin() throws Error{limit} beyond that.
    explicit ArrayMesh(std::uint64_t memory) : memory_(memory) {}

    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool holds_float64() const override { return false; }

    [[nodiscard]] const MeshLayout& layout() const { return layout_; }
    [[nodiscard]] NumberArrays& arrays() { return arrays_; }

  private:
    std::uint64_t memory_;
    MeshLayout layout_;
    NumberArrays arrays_;
};

/// A grid of points in a plane: pixel (i, j) is the point origin + i right + j down.
struct PixelGrid {
    Double3 origin{};  ///< the centre of the first pixel
    Double3 right{};   ///< from a pixel's centre to the next one's
    Double3 down{};    ///< from a row to the next one; at right angles to `right`
    int width = 0;
    int height = 0;
};

/// The values of a slice at the pixels of a grid in its plane: those of the mesh, so its error
/// bound holds for each pixel. NaN where the mesh has no triangle. The mesh is not kept.
class PixelValues : public MeshSink {
  public:
    explicit PixelValues(const PixelGrid& grid);

    void begin(const MeshLayout& layout) override { layout_ = layout; }
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool holds_float64() const override { return false; }

    [[nodiscard]] std::vector<float>& values() { return values_; }

  private:
    /// A corner of a triangle: its position in pixels, and its value.
    struct Corner {
        double x = 0;
        double y = 0;
        double value = 0;
    };
    void draw(const std::array<Corner, 3>& t);

    PixelGrid grid_;
    MeshLayout layout_;
    std::vector<float> values_;  ///< rows of the image, one after the other
};

/// Answers requests for arrays, one after the other. Not thread-safe.
class ArrayAnswers {
  public:
    /// `store` must outlive this object.
    ArrayAnswers(const Store& store, const view::MemoryShares& shares, bool are_labels)
        : store_(store), shares_(shares), are_labels_(are_labels) {}

    /// Answers in JSON, with what is known about the mesh or image; its arrays are in arrays().
    ///
    /// `/arrays/surface`, with the parameters of `/api/surface` (PROTOCOL.md) except `camera` and
    /// `limit`. `effort=none`, `fast` or `best` also holds for an error. `triangles=N` is the
    /// smallest distance for N. In addition: `close=below` or `above`, `normals=0`. For data
    /// in a plane: the isolines.
    ///
    /// `/arrays/slice`, with `plane`, `error` and `box`: triangles with values.
    ///
    /// `/arrays/image`, the same with `origin=x,y,z`, `right=x,y,z`, `down=x,y,z`, `width=N` and
    /// `height=N`: the values at these pixels.
    ///
    /// Throws what the queries throw, Error{invalid_argument} for parameters, and Error{limit}.
    view::HttpAnswer answer(view::RequestTarget& request, Progress& progress);

    [[nodiscard]] const NumberArrays& arrays() const { return arrays_; }
    void clear() { arrays_ = {}; }

  private:
    view::HttpAnswer surface(view::RequestTarget& request, Progress& progress);
    view::HttpAnswer slice(view::RequestTarget& request, bool is_image, Progress& progress);

    const Store& store_;
    view::MemoryShares shares_;
    bool are_labels_;
    NumberArrays arrays_;
};

}  // namespace isonest::detail::web
