// Gives every vertex of the mesh one number, across all parts.
#pragma once

#include <vector>

#include "query/mesh/part_store.h"
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
    /// The numbers of a part's vertices; `owned[i]` says that part `record` is the first to name i.
    /// Thread-safe.
    virtual void numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                         std::vector<bool>& owned) const = 0;
};

/// Numbers in the order in which the triangles of the parts, taken in order, first name the
/// vertices: so they do not depend on how the mesh was cut into parts. What grows with the mesh
/// lies in temporary files.
class Weld : public VertexNumbers {
  public:
    enum class Cuts { united, apart };
    /// `cuts`: whether elements that are alike as MeshPart::Cut says are one vertex, too. REQUIRES:
    /// parts.seal() was called. Throws Error{io}.
    Weld(PartStore& parts, const ScratchFolder& folder, Cuts cuts = Cuts::united);

    [[nodiscard]] std::uint64_t vertices() const override { return vertices_; }
    [[nodiscard]] std::uint64_t triangles() const override { return triangles_; }
    void numbers(const PartRecord& record, std::vector<std::uint64_t>& number,
                 std::vector<bool>& owned) const override;
    /// Shared elements that are one vertex have one representative: the first of them that has a
    /// vertex; if none has, any. Elements are counted over all parts (PartRecord::first_shared).
    [[nodiscard]] std::uint64_t representative(std::uint64_t element) const {
        return elements_[element].parent;
    }

  private:
    struct Element {
        std::uint64_t parent;  ///< union-find; after welding, the representative
        std::uint32_t part;
        std::uint32_t vertex;
        std::uint64_t skipped;  ///< vertices of the same part before this one that others own
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

}  // namespace isonest::detail
