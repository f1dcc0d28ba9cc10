// Fewer triangles for a whole mesh, within a distance that is proven; out of core.
//
// The mesh is cut into blocks with locked borders, each of which is simplified by itself and
// measured against the full surface; then once more with other borders, so that no seams stay. The
// argument why the bound holds is in query/DISTANCE.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"

namespace isonest::detail {

/// Heap that one thread needs for a block.
std::uint64_t simplify_heap();

/// Triangles that name vertices of the mesh that was simplified.
class SimplifiedMesh {
  public:
    /// `limit`: world units, > 0; both directions, between the triangles of `mesh` as they are
    /// in float32 and those of the result. The topology is that of `mesh`, and the result the same
    /// for any number of threads. REQUIRES: mesh.layout().corners == 3, and is called within an
    /// arena of as many threads as there is memory for. Throws Error{io, cancelled}.
    SimplifiedMesh(const ScratchMesh& mesh, const WorldLattice& lattice, double limit,
                   const std::filesystem::path& folder, Progress& progress);

    [[nodiscard]] std::span<const ElementCorners> corners() const {
        return {corner_file_.as<ElementCorners>().data(), count_};
    }
    /// The largest distance that was met, at most the limit; 0 if nothing was simplified.
    [[nodiscard]] double bound() const { return bound_; }
    /// Bytes of all temporary files, at most.
    [[nodiscard]] std::uint64_t scratch_bytes() const { return scratch_bytes_; }

  private:
    ScratchFile corner_file_;
    std::uint64_t count_ = 0;
    double bound_ = 0;
    std::uint64_t scratch_bytes_ = 0;
};

}  // namespace isonest::detail
