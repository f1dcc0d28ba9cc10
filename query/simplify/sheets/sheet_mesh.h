// A mesh in which sheets meet in lines, as sheets: each vertex once for each kind of sheet around
// it.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/mesh_sink.h>

#include "query/mesh/corner_file.h"
#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A sink for triangles with a label on either side. Triangles between the same two labels are of
/// one *interface*. Where interfaces meet, in a *line*, each has vertices of its own, which are
/// *copies* of one vertex of the mesh that came: so an interface is a mesh with borders, and copies
/// say what belongs together. What grows with the mesh lies in temporary files. Thread-safety: that
/// of a sink which is not concurrent; once end() was called, that of constant data.
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

    /// Has the copies as vertices, and no elements.
    [[nodiscard]] const ScratchMesh& vertices() const { return mesh_; }
    [[nodiscard]] CornerView triangles() const { return corners_.all(); }
    /// Of the layout that came.
    [[nodiscard]] const Sides& sides_range() const { return layout_.sides_range; }
    /// Nobody will look at these triangles any more, each of which is released once.
    void release(std::uint64_t first, std::uint64_t count) { corners_.release(first, count); }
    /// The labels behind and in front of all triangles with this vertex.
    [[nodiscard]] const Sides& sides(std::uint64_t vertex) const {
        return copy_file_.as<const Copy>()[vertex].sides;
    }
    /// The number that the vertex had in the mesh that came.
    [[nodiscard]] std::uint64_t original(std::uint64_t vertex) const {
        return copy_file_.as<const Copy>()[vertex].original;
    }
    /// Of each vertex the next one that is a copy of the same: rings, of one vertex where all is
    /// one interface.
    [[nodiscard]] std::span<const std::uint64_t> next_copies() const {
        return {next_file_.as<const std::uint64_t>().data(),
                static_cast<std::size_t>(mesh_.layout().vertices)};
    }

  private:
    struct Copy {
        Sides sides{};
        std::uint64_t original = 0;
        std::uint64_t next = 0;  ///< of the same original, from 1 on; 0: none
    };
    std::uint64_t copy_of(std::uint64_t original, const Sides& sides);
    void finish_vertices();

    ScratchFile position_file_;  ///< of the mesh that came
    ScratchFile first_file_;     ///< of each of its vertices the first copy, from 1 on
    ScratchFile copy_file_;
    ScratchFile next_file_;
    CornerFile corners_;
    ScratchMesh mesh_;
    MeshLayout layout_;
    std::uint64_t copies_ = 0;
    std::uint64_t room_ = 0;  ///< for copies
};

}  // namespace isonest::detail
