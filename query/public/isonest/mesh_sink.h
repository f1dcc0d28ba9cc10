// Destinations of the triangles or lines of an extraction: memory of the caller, a function, or a
// file (see mesh_file.h).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <isonest/frame.h>
#include <isonest/length_unit.h>

namespace isonest {

/// Numbers stored for each vertex of a mesh.
struct VertexAttribute {
    std::string name =
        {};  ///< "normal" (3 components, unit length); "value", "error" or "isovalue" (1 component)
    int components = 1;
    bool is_double = false;  ///< float64, used if float32 would round the values; else float32
    std::size_t offset = 0;  ///< bytes from the start of a vertex's row
    /// Whether all vertices of an element have the same value. File formats with per-element data
    /// then also store it per element.
    bool same_in_element = false;

    [[nodiscard]] std::size_t bytes() const {
        return static_cast<std::size_t>(components) * (is_double ? sizeof(double) : sizeof(float));
    }
};

/// Sizes and properties of a mesh.
struct MeshLayout {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;  ///< triangles, or lines
    int corners = 3;             ///< per element: 3, or 2 for lines
    std::vector<VertexAttribute> attributes = {};
    std::size_t row_bytes = 0;  ///< bytes of all attributes of one vertex
    /// Corners of an empty box, to be extended by each vertex.
    static constexpr std::array<float, 3> kEmptyLo{std::numeric_limits<float>::max(),
                                                   std::numeric_limits<float>::max(),
                                                   std::numeric_limits<float>::max()};
    static constexpr std::array<float, 3> kEmptyHi{std::numeric_limits<float>::lowest(),
                                                   std::numeric_limits<float>::lowest(),
                                                   std::numeric_limits<float>::lowest()};
    /// Bounding box of all vertices; lo > hi if there are none.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    std::optional<LengthUnit> unit = {};               ///< of the coordinates; nothing if unknown
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of the coordinates
    bool has_sides = false;  ///< elements come with the labels on both sides
    /// The smallest and the largest label in ElementBatch::sides.
    std::array<std::int64_t, 2> sides_range{};

    /// Returns null if there is no attribute of that name.
    [[nodiscard]] const VertexAttribute* find(std::string_view name) const;
};

/// The vertices `first`, `first` + 1, ... of a mesh. The memory belongs to the caller and is valid
/// only during the call.
struct VertexBatch {
    std::uint64_t first = 0;
    std::span<const std::array<float, 3>> positions = {};  ///< world coordinates x, y, z
    /// One row per vertex, packed, in native byte order; alignment is at most 4 bytes.
    std::span<const std::byte> attributes = {};
    std::size_t row_bytes = 0;  ///< as in the layout

    /// One component of an attribute of vertex first + i.
    [[nodiscard]] double number(std::size_t i, const VertexAttribute& attribute,
                                int component = 0) const;
};

/// The triangles (or lines) `first`, `first` + 1, ... of a mesh. The memory belongs to the caller
/// and is valid only during the call.
struct ElementBatch {
    std::uint64_t first = 0;
    /// Vertex numbers in the whole mesh. For a line, the third repeats the second.
    std::span<const std::array<std::uint64_t, 3>> corners = {};
    /// The same corners again, for drawing without storing all vertices: indices into `nearby`.
    /// Those vertices have no numbers of their own (`nearby.first` has no meaning).
    std::span<const std::array<std::uint32_t, 3>> nearby_corners = {};
    VertexBatch nearby = {};
    /// If the layout has sides: the labels behind and in front of each triangle, which faces from
    /// the first to the second.
    std::span<const std::array<std::int64_t, 2>> sides = {};
};

/// Receives a mesh: prepare(), then (after the extraction's work) begin(), all batches, end(). Each
/// vertex and each element comes exactly once per pass. Numbering depends on the store and the
/// query, not on threads or memory; batch sizes do depend on them. If anything fails, end() is not
/// called and what was received is incomplete. A sink may throw any exception; the extraction then
/// ends with it.
class MeshSink {
  public:
    /// Maximum number of rows in a batch.
    static constexpr std::size_t kMaxRows = std::size_t{1} << 17U;
    [[deprecated("now called kMaxRows")]] static constexpr std::size_t kMostRows = kMaxRows;

    MeshSink() = default;
    MeshSink(const MeshSink&) = delete;
    MeshSink& operator=(const MeshSink&) = delete;
    virtual ~MeshSink() = default;

    /// Called before the work: the place to reject a mesh that the sink cannot store. `layout` has
    /// no counts and no box yet. `inputs` are the files being read; none of them may be
    /// overwritten.
    virtual void prepare(const MeshLayout& /*layout*/,
                         std::span<const std::filesystem::path> /*inputs*/) {}
    virtual void begin(const MeshLayout& layout) = 0;
    virtual void add_vertices(const VertexBatch& batch) = 0;
    virtual void add_elements(const ElementBatch& batch) = 0;
    /// Called after all batches. Return true to receive all of them again, through add_vertices()
    /// and add_elements().
    [[nodiscard]] virtual bool again() { return false; }
    virtual void end() {}

    /// Return true if add_vertices() and add_elements() may be called from several threads at once
    /// and in any order. Otherwise they are called from one thread at a time, in ascending order,
    /// with all vertices before the first element.
    [[nodiscard]] virtual bool concurrent() const { return false; }
    /// Return false if all values must be float32; the report gives the resulting rounding error.
    [[nodiscard]] virtual bool holds_float64() const { return true; }
};

/// A mesh in memory. begin() replaces the previous contents.
class MeshCollector : public MeshSink {
  public:
    std::vector<std::array<float, 3>> vertices;  ///< world coordinates x, y, z
    /// Vertex numbers; one of the two is empty.
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<std::array<std::uint32_t, 2>> lines;
    /// One per vertex; empty if not requested.
    std::vector<std::array<float, 3>> normals;
    std::vector<double> values;
    std::vector<float> errors;
    /// For each triangle, the labels behind and in front of it; empty if the mesh has no sides.
    std::vector<std::array<std::int64_t, 2>> sides;

    /// Throws Error{limit} for more than 2^32 - 1 vertices, and std::bad_alloc.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }

  private:
    MeshLayout layout_;
};

/// Passes every batch to a function: one thread at a time, in ascending order, all vertices first.
class CallbackSink : public MeshSink {
  public:
    using OnVertices = std::function<void(const VertexBatch& batch)>;
    using OnElements = std::function<void(const ElementBatch& batch)>;
    /// Either function may be empty: its batches are then ignored.
    CallbackSink(OnVertices on_vertices, OnElements on_elements)
        : on_vertices_(std::move(on_vertices)), on_elements_(std::move(on_elements)) {}

    /// Layout of the current mesh.
    [[nodiscard]] const MeshLayout& layout() const { return layout_; }

    void begin(const MeshLayout& layout) override { layout_ = layout; }
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;

  private:
    OnVertices on_vertices_;
    OnElements on_elements_;
    MeshLayout layout_;
};

}  // namespace isonest
