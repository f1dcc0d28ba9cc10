// A mesh whose sheets meet in lines, represented as sheets: a vertex occurs once for each kind of
// sheet around it.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_files.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A sink for triangles with a label on either side. Triangles between the same two labels belong
/// to one *interface*. In a *line*, where interfaces meet, each interface has its own vertices,
/// which are *copies* of one vertex of the input mesh: so an interface is a mesh with borders, and
/// copies record what belongs together. Data that grows with the mesh is kept in temporary files.
/// Thread-safety: that of a sink which is not concurrent; after end(), that of constant data.
class SheetMesh : public MeshSink {
  public:
    using Sides = std::array<std::int64_t, 2>;

    explicit SheetMesh(const ScratchFolder& folder);

    /// REQUIRES: layout.has_sides.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    void end() override;

    // After end():

    /// The copies as vertices, without elements.
    [[nodiscard]] const ScratchMesh& vertices() const { return mesh_; }
    [[nodiscard]] CornerView triangles() const { return corners_.all(); }
    /// Of the input layout.
    [[nodiscard]] const Sides& sides_range() const { return layout_.sides_range; }
    /// Declares that these triangles will not be read any more; call once per triangle.
    void release(std::uint64_t first, std::uint64_t count) { corners_.release(first, count); }
    /// The labels behind and in front of all triangles with this vertex.
    [[nodiscard]] const Sides& sides(std::uint64_t vertex) const {
        return copy_file_.as<const Copy>()[vertex].sides;
    }
    /// The number of the vertex in the input mesh.
    [[nodiscard]] std::uint64_t original(std::uint64_t vertex) const {
        return copy_file_.as<const Copy>()[vertex].original;
    }
    /// For each vertex the next copy of the same original: rings; a ring of one vertex inside an
    /// interface.
    [[nodiscard]] std::span<const std::uint64_t> next_copies() const {
        return {next_file_.as<const std::uint64_t>().data(),
                static_cast<std::size_t>(mesh_.layout().vertices)};
    }

  private:
    struct Copy {
        Sides sides{};
        std::uint64_t original = 0;
        std::uint64_t next = 0;  ///< next copy of the same original, counted from 1; 0: none
    };
    std::uint64_t copy_of(std::uint64_t original, const Sides& sides);
    void finish_vertices();

    ScratchFile position_file_;  ///< of the input mesh
    ScratchFile first_file_;     ///< first copy of each vertex of the input mesh, counted from 1
    ScratchFile copy_file_;
    ScratchFile next_file_;
    CornerFile corners_;
    ScratchMesh mesh_;
    MeshLayout layout_;
    std::uint64_t copies_ = 0;
    std::uint64_t room_ = 0;  ///< allocated copies
};

// Outputs the meshes of the sheets of a SheetMesh after simplification: of all sheets, or of those
// around one label.

/// Size of the output.
struct SheetCounts {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t no_area = 0;  ///< triangles without area
};

/// Vertices are those of the SheetMesh's input, each once, in the order of their numbers there;
/// triangles keep their order. Thread-safety: any number of concurrent calls of emit_...().
class SheetOutput {
  public:
    /// `triangles`: their corners are copies of `sheets`. `labels`: the labels that will get
    /// meshes, ascending. Both must outlive this object. Throws Error{io, cancelled}.
    SheetOutput(const SheetMesh& sheets, const CornerView& triangles,
                std::span<const std::int64_t> labels, const ScratchFolder& folder,
                Progress& progress);

    /// Calls begin(), all batches as often as the sink requests them, and end(). `layout`: that of
    /// prepare(), without attributes. Throws what the sink throws, and Error{io, cancelled}.
    SheetCounts emit_all(MeshLayout layout, MeshSink& sink, const Progress& progress) const;
    /// The same for labels[number], with triangles facing out of it.
    SheetCounts emit_label(std::size_t number, MeshLayout layout, MeshSink& sink,
                           const Progress& progress) const;

    /// Number of triangles of labels[number].
    [[nodiscard]] std::uint64_t triangles(std::size_t number) const {
        return of_labels_.of(static_cast<std::uint32_t>(number)).size();
    }

    /// The labels on the other side of labels[number], with the areas shared with them, square
    /// world units. Memory grows with the number of these labels.
    [[nodiscard]] std::map<std::int64_t, double> areas(std::size_t number) const;

    /// Maximum heap that a call needs, bytes.
    static constexpr std::uint64_t kHeap = std::uint64_t{12} << 20U;

  private:
    /// A triangle of a label's mesh.
    struct LabelTriangle {
        std::uint64_t triangle = 0;
        std::uint32_t block = 0;  ///< number of the label
        bool is_reversed = false;
    };
    struct Vertex {
        std::uint64_t original = 0;
        std::uint64_t copy = 0;
    };
    template <class At>
    SheetCounts emit(std::uint64_t count, const At& at, MeshLayout layout, MeshSink& sink,
                     const Progress& progress) const;

    const SheetMesh& sheets_;
    CornerView triangles_;
    std::span<const std::int64_t> labels_;
    ScratchFolder folder_;
    SortedByBlocks<LabelTriangle> of_labels_;
};

}  // namespace isonest::detail
