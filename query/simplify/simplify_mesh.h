// Simplifies a whole mesh within a proven distance; out of core.
//
// The mesh is divided into blocks with locked borders. Each is simplified on its own and measured
// against the full surface. This is repeated with different borders, so that no seams remain.
// query/DISTANCE.md explains why the bound holds.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_files.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/patch.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The vertices of a simplified mesh that are not vertices of the full surface.
//
// Each is a copy of a vertex of the full surface, its origin, at another place near the full
// surface. It has the attributes of its origin.

/// Thread-safety: constant except for add() and give_own_places().
class MovedVertices {
  public:
    using Copies = GrowingFile<ScratchMesh::MovedCopy>;

    /// `mesh`: has the vertices of the full surface; it must outlive this object.
    MovedVertices(ScratchMesh& mesh, const ScratchFolder& folder)
        : mesh_(mesh), first_(mesh.layout().vertices), origins_(folder) {}

    /// The number of the next moved vertex.
    [[nodiscard]] std::uint64_t next() const { return mesh_.layout().vertices; }
    [[nodiscard]] bool empty() const { return next() == first_; }
    /// The origin of a moved vertex; for a vertex of the full surface, the vertex itself.
    [[nodiscard]] std::uint64_t origin_of(std::uint64_t vertex) const {
        return vertex < first_ ? vertex : origins_.all()[vertex - first_];
    }
    /// Adds copies as vertices of the mesh, each with its origin. Throws Error{io}.
    void add(Copies& copies);

    /// Separates moved vertices that are at the same place as other ones of `vertices`, by units in
    /// the last place of their coordinates, so that joining vertices by their positions gives the
    /// same mesh. `vertices`: of the mesh, each once; their order is changed. Vertices of the full
    /// surface are already at different places (query/apart/keep_apart.h), and moved ones hardly
    /// ever meet another vertex. Returns the maximum distance by which a vertex was moved; at most
    /// `most` (world units): if that is not enough, vertices stay together.
    double give_own_places(std::span<std::uint64_t> vertices, double most);

  private:
    ScratchMesh& mesh_;
    std::uint64_t first_;
    GrowingFile<std::uint64_t> origins_;
};

/// Heap that one thread needs for a block.
std::uint64_t simplify_heap();

struct Simplified;

/// Simplifies a mesh within distances from it. Each result is made from the mesh itself or from a
/// result within a smaller distance. Distances are always measured from the full mesh with float32
/// vertices; the topology is preserved; results do not depend on the number of threads. Not
/// thread-safe; works in the caller's arena, which has as many threads as there is memory for.
class MeshSimplifier {
  public:
    /// `triangles`: the full surface, with corners that are vertices of `mesh`; both must outlive
    /// this object. Adds vertices to `mesh`: copies of the surface's vertices at other places near
    /// it, used by the triangles of results. `box`: to which the surface is clipped. REQUIRES:
    /// mesh.layout().corners == 3. Throws Error{io, cancelled}, as all members do.
    MeshSimplifier(ScratchMesh& mesh, const CornerView& triangles, const WorldLattice& lattice,
                   const PatchBox& box, ScratchFolder folder, Progress& progress);
    ~MeshSimplifier();
    MeshSimplifier(const MeshSimplifier&) = delete;
    MeshSimplifier& operator=(const MeshSimplifier&) = delete;

    [[nodiscard]] Simplified full() const;
    /// About `most` triangles of the full mesh, from blocks distributed all over it, as a sample
    /// for the search for a limit. Borders between included and excluded blocks count as borders of
    /// the mesh. Returns the whole mesh if it is not much larger.
    [[nodiscard]] Simplified sample(std::uint64_t most) const;
    /// `limit`: world units, > 0 and at least the limit of `from`.
    [[nodiscard]] Simplified within(const Simplified& from, double limit);
    [[nodiscard]] CornerFile corners(const Simplified& of) const;

  private:
    friend struct Simplified;
    struct Run;
    struct Block;
    std::shared_ptr<Run> pass(Run& from, const CollapseLimits& limits, bool afresh, bool is_last);
    [[nodiscard]] Block load(const Run& run, const Valences& valences, std::uint32_t block,
                             bool afresh) const;
    template <class Visit>
    void each(const Run& run, const Visit& visit) const;
    void finish(Run& run) const;
    [[nodiscard]] double reserve(double limit) const;
    double give_own_places(const Run& run, double most);

    const ScratchMesh& mesh_;
    MovedVertices moved_;
    CornerView triangles_;  ///< of the full surface
    double unit_;           ///< unit in the last place of the largest coordinate
    PatchBox box_;
    ScratchFolder folder_;
    Progress& progress_;
    std::vector<std::unique_ptr<BlockGrid>> grids_;
    std::shared_ptr<Run> full_;
};

/// A mesh near the full one; its temporary files are removed with the last copy.
struct Simplified {
    std::shared_ptr<MeshSimplifier::Run> run;
    std::uint64_t triangles = 0;
    double bound = 0;  ///< the largest distance that occurred, at most the limit
    double limit = 0;  ///< limit of the simplification; 0: the full mesh
};

}  // namespace isonest::detail
