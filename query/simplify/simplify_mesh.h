// Fewer triangles for a whole mesh, within a distance that is proven; out of core.
//
// The mesh is cut into blocks with locked borders, each of which is simplified by itself and
// measured against the full surface; then once more with other borders, so that no seams stay. The
// argument why the bound holds is in query/DISTANCE.md.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/block_patch.h"
#include "query/simplify/moved_vertices.h"
#include "query/simplify/patch.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Heap that one thread needs for a block.
std::uint64_t simplify_heap();

struct Simplified;

/// Simplifies a mesh within distances from it, each result from the mesh itself or from a result
/// within a smaller distance. Distances are always from the full mesh, as its vertices are in
/// float32; the topology stays; the results are the same for any number of threads. Not
/// thread-safe; it works in the arena of its caller, which has as many threads as there is memory
/// for.
class MeshSimplifier {
  public:
    /// `triangles`: the full surface, whose corners are vertices of `mesh`; both have to stay.
    /// `mesh` gets further vertices: copies of the surface's, at other places near to it, which
    /// triangles of results have for corners. `box`: to which the surface is cut.
    /// REQUIRES: mesh.layout().corners == 3. Throws Error{io, cancelled}, as all members do.
    MeshSimplifier(ScratchMesh& mesh, const CornerView& triangles, const WorldLattice& lattice,
                   const PatchBox& box, ScratchFolder folder, Progress& progress);
    ~MeshSimplifier();
    MeshSimplifier(const MeshSimplifier&) = delete;
    MeshSimplifier& operator=(const MeshSimplifier&) = delete;

    [[nodiscard]] Simplified full() const;
    /// About `most` triangles of the full mesh, those of blocks from all over it, which stand for
    /// all of it where a limit is looked for: borders between the blocks that are in and those that
    /// are not count as borders of the mesh. All of it if it is not much larger than that.
    [[nodiscard]] Simplified sample(std::uint64_t most) const;
    /// `limit`: world units, > 0 and at least that within which `from` is.
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
    double unit_;           ///< in the last place of the largest coordinate
    PatchBox box_;
    ScratchFolder folder_;
    Progress& progress_;
    std::vector<std::unique_ptr<BlockGrid>> grids_;
    std::shared_ptr<Run> full_;
};

/// A mesh near to the full one; its temporary files go with the last copy.
struct Simplified {
    std::shared_ptr<MeshSimplifier::Run> run;
    std::uint64_t triangles = 0;
    double bound = 0;  ///< the largest distance that was met, at most the limit
    double limit = 0;  ///< within which it was simplified; 0: the full mesh
};

}  // namespace isonest::detail
