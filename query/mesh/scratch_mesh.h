// A whole mesh in temporary files: what the stages work on that change a mesh after its vertices
// have been welded.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/corner_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A sink that keeps the mesh in temporary files, which grow as it comes, and are mapped by end():
/// then it can be read. Thread-safety: that of a concurrent sink; once end() was called, that of
/// constant data.
class ScratchMesh : public MeshSink {
  public:
    explicit ScratchMesh(const ScratchFolder& folder,
                         CornerFile::Bits bits = CornerFile::Bits::as_needed);

    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    void end() override;
    [[nodiscard]] bool concurrent() const override { return true; }

    [[nodiscard]] const MeshLayout& layout() const { return layout_; }
    [[nodiscard]] std::span<const std::array<float, 3>> positions() const {
        return {position_file_.as<std::array<float, 3>>().data(),
                static_cast<std::size_t>(layout_.vertices)};
    }
    /// The attributes of vertex `v`.
    [[nodiscard]] std::span<const std::byte> row(std::uint64_t v) const {
        return row_file_.as<const std::byte>().subspan(v * layout_.row_bytes, layout_.row_bytes);
    }
    /// The attributes of all vertices.
    [[nodiscard]] std::span<const std::byte> rows() const {
        return row_file_.as<const std::byte>().first(layout_.vertices * layout_.row_bytes);
    }
    [[nodiscard]] CornerView corners() const { return corners_.all(); }
    /// REQUIRES: the mesh was made with Bits::all.
    [[nodiscard]] std::span<const ElementCorners> corners_in_64_bits() const {
        return corners_.in_64_bits();
    }

    /// As a corner: the element is to go.
    static constexpr std::uint64_t kNoVertex = CornerFile::kNoVertex;
    /// For whoever changes the mesh; the box of its layout stays as it is.
    [[nodiscard]] std::span<std::array<float, 3>> changeable_positions() {
        return {position_file_.as<std::array<float, 3>>().data(),
                static_cast<std::size_t>(layout_.vertices)};
    }
    [[nodiscard]] std::span<std::byte> changeable_rows() {
        return row_file_.as<std::byte>().first(layout_.vertices * layout_.row_bytes);
    }
    [[nodiscard]] CornerFile& changeable_corners() { return corners_; }
    /// A further vertex: a copy of one of the mesh, at another place.
    struct MovedCopy {
        std::array<float, 3> at{};
        std::uint64_t of = 0;
    };
    /// They get the numbers that follow; no element has them. The box of the layout stays as it is.
    /// Spans of vertices from before are invalid. Throws Error{io}.
    void add_copies(std::span<const MovedCopy> copies);
    /// Takes elements out whose first corner is kNoVertex, and vertices that none of the others
    /// names. The order stays. Views from before are invalid. Throws Error{io, cancelled}.
    void compact(const ScratchFolder& folder, Progress& progress);

  private:
    ScratchFile position_file_;
    ScratchFile row_file_;
    CornerFile corners_;
    MeshLayout layout_;
};

/// Vertices and elements of what emit_elements() handed over, and where float32 left no area.
struct EmittedMesh {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;
    std::uint64_t zero_area_triangles = 0;
};

/// Hands `elements`, whose corners are vertices of `mesh`, to a sink: begin(), all batches as often
/// as the sink asks for them, end(). Only vertices that they name, numbered in the order in which
/// they are first named. What grows with the mesh lies in temporary files in `folder`. Throws
/// Error{io, cancelled} and what the sink throws.
EmittedMesh emit_elements(const ScratchMesh& mesh, const CornerView& elements,
                          const ScratchFolder& folder, MeshSink& sink, Progress& progress);

/// Hands all vertices, or all elements, of a mesh to a sink, with the numbers that they have, and
/// nothing else. Throws Error{cancelled} and what the sink throws.
void emit_vertices(const ScratchMesh& mesh, MeshSink& sink, Progress& progress);
void emit_elements(const ScratchMesh& mesh, MeshSink& sink, Progress& progress);

}  // namespace isonest::detail
