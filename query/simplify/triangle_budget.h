// The smallest distance at which a mesh has few enough triangles.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/simplify_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Meshes near a full surface, each within a larger distance than the one before.

/// The distance of the first step, in voxels; each step is larger than the previous one by a factor
/// of the square root of 2.
inline constexpr double kFirstLadderStep = 0.125;

struct LadderStep {
    std::unique_ptr<ScratchMesh> mesh;
    double bound = 0;  ///< proven distance from the full surface, world units
};

/// Steps of up to 4 voxels; fewer if a larger distance leaves nearly as many triangles. Each is
/// made from the previous one and measured from the full surface. `mesh`: the simplifier's mesh.
/// `voxel`: world units. `moved`: the part of each distance used by float32. Throws what the
/// simplifier throws.
std::vector<LadderStep> distance_ladder(MeshSimplifier& simplifier, const ScratchMesh& mesh,
                                        double voxel, double moved, const ScratchFolder& folder,
                                        Progress& progress);

/// Searches for the smallest limit, from about `first` up to `most` (world units), for which the
/// mesh has at most `triangles`; stops when it has nearly as many. Counts do not always decrease
/// with the limit: the result is the smallest limit that was tried. It does not depend on the
/// number of threads. If there are too many triangles even at `most`, returns the mesh within
/// `most`. Throws what the simplifier throws.
Simplified within_budget(MeshSimplifier& simplifier, std::uint64_t triangles, double first,
                         double most);

}  // namespace isonest::detail
