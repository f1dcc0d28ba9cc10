// Assigns one number to every vertex of the mesh, across all parts.
#pragma once

#include <vector>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/march/vertex_attributes.h"
#include "query/mesh/part_store.h"
#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The numbers that the vertices of some parts have in the whole mesh.
class VertexNumbers {
  public:
    VertexNumbers() = default;
    VertexNumbers(const VertexNumbers&) = delete;
    VertexNumbers& operator=(const VertexNumbers&) = delete;
    virtual ~VertexNumbers() = default;
    /// Of the whole mesh.
    [[nodiscard]] virtual std::uint64_t vertices() const = 0;
    [[nodiscard]] virtual std::uint64_t triangles() const = 0;
    /// The numbers of a part's vertices. `owned[i]`: part `record` is the first that uses vertex i.
    /// Thread-safe.
    virtual void numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                         std::vector<bool>& owned) const = 0;
};

/// Numbers vertices in the order of their first use by the triangles of the parts, taken in order:
/// so numbers do not depend on how the mesh was divided into parts. Data that grows with the mesh
/// is kept in temporary files.
class Weld : public VertexNumbers {
  public:
    enum class Cuts { united, apart };
    /// `cuts`: whether elements that are equal according to MeshPart::Cut are also merged.
    /// REQUIRES: parts.seal() was called. Throws Error{io}.
    Weld(PartStore& parts, const ScratchFolder& folder, Cuts cuts = Cuts::united);

    [[nodiscard]] std::uint64_t vertices() const override { return vertices_; }
    [[nodiscard]] std::uint64_t triangles() const override { return triangles_; }
    void numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                 std::vector<bool>& owned) const override;
    /// Shared elements that are one vertex have one representative: the first of them with a
    /// vertex, or any if none has one. Elements are counted over all parts
    /// (PartRecord::first_shared).
    [[nodiscard]] std::uint64_t representative(std::uint64_t element) const {
        return elements_[element].parent;
    }

  private:
    struct Element {
        std::uint64_t parent;  ///< union-find; after welding, the representative
        std::uint32_t part;
        std::uint32_t vertex;
        std::uint64_t skipped;  ///< vertices of the same part before this one that are owned by
                                ///< others
    };
    std::uint64_t root(std::uint64_t e);
    void unite(std::uint64_t a, std::uint64_t b);
    void unite_names(const ScratchFolder& folder);
    void unite_cuts(const ScratchFolder& folder);

    PartStore& parts_;
    ScratchFile element_file_;
    std::span<Element> elements_;
    std::uint64_t vertices_ = 0;
    std::uint64_t triangles_ = 0;
};

// Outputs a welded mesh to a sink.

/// The layout without counts and box, as for MeshSink::prepare(). `corners`: per element, 3 or 2.
MeshLayout layout_of(const AttributeChoice& attributes, int corners, std::optional<LengthUnit> unit,
                     AnatomicalFrame frame);

/// Calls begin(), all batches as often as the sink requests them, and end(). `layout`: that of
/// prepare(). For triangles and for lines ("triangles" whose last two corners are equal). Throws
/// what the sink throws, and Error{cancelled}.
void emit_mesh(const PartStore& parts, const VertexNumbers& weld, MeshLayout layout, MeshSink& sink,
               Progress& progress);

/// Outputs all batches of these parts, which may be some of a mesh's. REQUIRES: the sink is
/// concurrent. Throws what the sink throws, and Error{cancelled}.
void emit_parts(const PartStore& parts, const VertexNumbers& weld, MeshSink& sink,
                Progress& progress);

/// Moves everything into `mesh`, including begin() and end(). The space of each part is freed as
/// soon as it was output: only the records of `parts` are left. Throws Error{io, cancelled}.
void move_mesh(PartStore& parts, const VertexNumbers& weld, MeshLayout layout, ScratchMesh& mesh,
               Progress& progress);

}  // namespace isonest::detail
