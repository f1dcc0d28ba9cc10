// The vertices of a simplified mesh that are no vertices of the full surface any more.
//
// Each is a copy of one of those, at a place near to the full surface: it has the attributes of the
// one that it is a copy of, its origin.
#pragma once

#include <cstdint>
#include <span>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Thread-safety: constant but for add() and give_own_places().
class MovedVertices {
  public:
    using Copies = GrowingFile<ScratchMesh::MovedCopy>;

    /// `mesh`: has the vertices of the full surface; it has to stay.
    MovedVertices(ScratchMesh& mesh, const ScratchFolder& folder)
        : mesh_(mesh), first_(mesh.layout().vertices), origins_(folder) {}

    /// The number that the next one gets.
    [[nodiscard]] std::uint64_t next() const { return mesh_.layout().vertices; }
    [[nodiscard]] bool empty() const { return next() == first_; }
    /// That of a moved vertex; of one of the full surface, itself.
    [[nodiscard]] std::uint64_t origin_of(std::uint64_t vertex) const {
        return vertex < first_ ? vertex : origins_.all()[vertex - first_];
    }
    /// They become vertices of the mesh. Each is of an origin. Throws Error{io}.
    void add(Copies& copies);

    /// Moves those of `vertices` (of the mesh, each once; their order is changed) that are moved
    /// ones and share their places with others of them by units in the last place of their
    /// coordinates: so that whoever joins vertices by their positions has the same mesh. The full
    /// surface's are alone in their places (query/apart/keep_apart.h), and moved ones hardly ever
    /// meet another vertex. Returns how far one was moved, at most; no further than `most` (world
    /// units): where that is not enough, they stay together.
    double give_own_places(std::span<std::uint64_t> vertices, double most);

  private:
    ScratchMesh& mesh_;
    std::uint64_t first_;
    GrowingFile<std::uint64_t> origins_;
};

}  // namespace isonest::detail
