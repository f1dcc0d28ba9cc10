// Where the triangles or lines of an extraction go: the caller's memory, a function, or (see
// mesh_file.h) a file.
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

/// Numbers that every vertex of a mesh carries.
struct VertexAttribute {
    std::string name =
        {};  ///< "normal" (3 components, unit length); "value", "error" or "isovalue" (1 component)
    int components = 1;
    bool is_double = false;  ///< float64, where float32 would round them; else float32
    std::size_t offset = 0;  ///< bytes from the beginning of a vertex's row
    /// Whether all vertices of an element have the same: file formats that hold numbers of elements
    /// have it as one of those, too.
    bool same_in_element = false;

    [[nodiscard]] std::size_t bytes() const {
        return static_cast<std::size_t>(components) * (is_double ? sizeof(double) : sizeof(float));
    }
};

/// What a mesh has.
struct MeshLayout {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;  ///< triangles, or lines
    int corners = 3;             ///< of an element: 3, or 2 for lines
    std::vector<VertexAttribute> attributes = {};
    std::size_t row_bytes = 0;  ///< of all attributes of one vertex
    /// The corners of a box that holds nothing yet, and grows with each vertex.
    static constexpr std::array<float, 3> kEmptyLo{std::numeric_limits<float>::max(),
                                                   std::numeric_limits<float>::max(),
                                                   std::numeric_limits<float>::max()};
    static constexpr std::array<float, 3> kEmptyHi{std::numeric_limits<float>::lowest(),
                                                   std::numeric_limits<float>::lowest(),
                                                   std::numeric_limits<float>::lowest()};
    /// The smallest box that holds all vertices; lo > hi if there is none.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    std::optional<LengthUnit> unit = {};  ///< of the coordinates; nothing: it is not known
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of the coordinates
    bool has_sides = false;  ///< every element comes with the labels beside it
    /// The smallest and the largest number that elements have beside them.
    std::array<std::int64_t, 2> sides_range{};

    /// Null if there is none of that name.
    [[nodiscard]] const VertexAttribute* find(std::string_view name) const;
};

/// Vertices number `first`, `first` + 1, ... of a mesh. The memory belongs to the caller and is
/// valid during the call.
struct VertexBatch {
    std::uint64_t first = 0;
    std::span<const std::array<float, 3>> positions = {};  ///< world coordinates x, y, z
    /// One row for each vertex, packed, native byte order; without alignment beyond 4 bytes.
    std::span<const std::byte> attributes = {};
    std::size_t row_bytes = 0;  ///< as in the layout

    /// A component of an attribute of the vertex number first + i.
    [[nodiscard]] double number(std::size_t i, const VertexAttribute& attribute,
                                int component = 0) const;
};

/// Triangles (or lines) number `first`, `first` + 1, ... of a mesh. The memory belongs to the
/// caller and is valid during the call.
struct ElementBatch {
    std::uint64_t first = 0;
    /// Vertex numbers in the whole mesh. Of a line the third repeats the second.
    std::span<const std::array<std::uint64_t, 3>> corners = {};
    /// The same corners once more, for whoever draws without keeping vertices: as places in
    /// `nearby`, whose vertices have no numbers of their own (its `first` means nothing).
    std::span<const std::array<std::uint32_t, 3>> nearby_corners = {};
    VertexBatch nearby = {};
    /// If the layout says so, the labels behind and in front of each triangle, which faces from the
    /// first to the second.
    std::span<const std::array<std::int64_t, 2>> sides = {};
};

/// Receives a mesh: prepare(), then (the work) begin(), all batches, end(). Every vertex and
/// every element comes exactly once in each pass. Numbers depend on the store and on what is asked
/// for, not on threads or memory; the sizes of the batches do depend on them.
/// If anything fails, end() is not called, and what came until then is no whole mesh. A sink may
/// throw whatever it likes; the extraction then ends with that exception.
class MeshSink {
  public:
    /// No batch has more rows.
    static constexpr std::size_t kMostRows = std::size_t{1} << 17U;

    MeshSink() = default;
    MeshSink(const MeshSink&) = delete;
    MeshSink& operator=(const MeshSink&) = delete;
    virtual ~MeshSink() = default;

    /// Before the work: the place to refuse what cannot be held. `layout` is without counts and
    /// box; `inputs` are the files that are read, none of which may be written.
    virtual void prepare(const MeshLayout& /*layout*/,
                         std::span<const std::filesystem::path> /*inputs*/) {}
    virtual void begin(const MeshLayout& layout) = 0;
    virtual void add_vertices(const VertexBatch& batch) = 0;
    virtual void add_elements(const ElementBatch& batch) = 0;
    /// After all batches: true if all of them are to come once more, as add_vertices() and
    /// add_elements().
    [[nodiscard]] virtual bool again() { return false; }
    virtual void end() {}

    /// True if add_vertices() and add_elements() may be called from several threads at once and in
    /// any order. Else they come from one thread at a time, in ascending order, and all vertices
    /// before the first element.
    [[nodiscard]] virtual bool concurrent() const { return false; }
    /// False if all values have to be float32; the report says by how much that rounds them.
    [[nodiscard]] virtual bool holds_float64() const { return true; }
};

/// A mesh in memory. What was there is replaced by begin().
class MeshCollector : public MeshSink {
  public:
    std::vector<std::array<float, 3>> vertices;  ///< world coordinates x, y, z
    /// Numbers of vertices; one of the two is empty.
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::vector<std::array<std::uint32_t, 2>> lines;
    /// For each vertex, or empty if not asked for.
    std::vector<std::array<float, 3>> normals;
    std::vector<double> values;
    std::vector<float> errors;
    /// For each triangle the labels behind and in front of it, or empty if the mesh has none.
    std::vector<std::array<std::int64_t, 2>> sides;

    /// Throws Error{limit} beyond 2^32 - 1 vertices, and std::bad_alloc.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool concurrent() const override { return true; }

  private:
    MeshLayout layout_;
};

/// Hands every batch to a function, one thread at a time, in ascending order, all vertices first.
class CallbackSink : public MeshSink {
  public:
    using OnVertices = std::function<void(const VertexBatch& batch)>;
    using OnElements = std::function<void(const ElementBatch& batch)>;
    /// Either may be empty: then the batches are dropped.
    CallbackSink(OnVertices on_vertices, OnElements on_elements)
        : on_vertices_(std::move(on_vertices)), on_elements_(std::move(on_elements)) {}

    /// Of the mesh whose batches come.
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
