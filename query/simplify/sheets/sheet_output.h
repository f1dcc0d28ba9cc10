// The meshes of what is left of the sheets of a SheetMesh: of all of them, or of those around one
// label.
#pragma once

#include <cstdint>
#include <map>
#include <span>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/corner_file.h"
#include "query/simplify/block_triangles.h"
#include "query/simplify/sheets/sheet_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// What was handed over.
struct SheetCounts {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    std::uint64_t no_area = 0;  ///< of the triangles
};

/// Vertices are those of the mesh that came to the SheetMesh, each once, in the order of their
/// numbers there; triangles come in their order. Thread-safety: any number of calls of emit_...()
/// at once.
class SheetOutput {
  public:
    /// `triangles`: their corners are copies of `sheets`. `labels`: which will get meshes,
    /// ascending. Both have to stay. Throws Error{io, cancelled}.
    SheetOutput(const SheetMesh& sheets, const CornerView& triangles,
                std::span<const std::int64_t> labels, const ScratchFolder& folder,
                Progress& progress);

    /// begin(), all batches as often as the sink asks for them, end(). `layout`: of prepare(),
    /// without attributes. Throw what the sink throws, and Error{io, cancelled}.
    SheetCounts emit_all(MeshLayout layout, MeshSink& sink, const Progress& progress) const;
    /// Of labels[number], facing out of it.
    SheetCounts emit_label(std::size_t number, MeshLayout layout, MeshSink& sink,
                           const Progress& progress) const;

    /// Of labels[number].
    [[nodiscard]] std::uint64_t triangles(std::size_t number) const {
        return of_labels_.of(static_cast<std::uint32_t>(number)).size();
    }

    /// What lies on the other side of labels[number], and the area that it shares with that, square
    /// world units. Memory grows with the number of what lies there.
    [[nodiscard]] std::map<std::int64_t, double> areas(std::size_t number) const;

    /// Bytes of heap that a call needs, at most.
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
