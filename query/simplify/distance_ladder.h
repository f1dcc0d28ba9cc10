// Meshes near to a full surface, each within a larger distance than the one before.
#pragma once

#include <memory>
#include <vector>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/simplify_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The distance of the first step, in voxels; from one to the next they grow by a factor of the
/// root of 2.
inline constexpr double kFirstLadderStep = 0.125;

struct LadderStep {
    std::unique_ptr<ScratchMesh> mesh;
    double bound = 0;  ///< proven distance from the full surface, world units
};

/// Steps of up to 4 voxels, fewer if a larger distance leaves nearly as many triangles. Each is
/// made from the one before and measured from the full surface. `mesh`: that of the simplifier.
/// `voxel`: world units. `moved`: what float32 takes of each distance. Throws what the simplifier
/// throws.
std::vector<LadderStep> distance_ladder(MeshSimplifier& simplifier, const ScratchMesh& mesh,
                                        double voxel, double moved, const ScratchFolder& folder,
                                        Progress& progress);

}  // namespace isonest::detail
