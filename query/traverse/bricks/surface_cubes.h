// Which cubes of a brick of level 0 the isosurface of the data passes through.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5, the interest test with beta_0 = 0, which
// holds where nothing is left to refine: first by the smallest and largest value of each chunk,
// then by the values. Without a tolerance every node refines, so that the coarser levels need not
// be asked.
#pragma once

#include <memory>

#include "query/march/clip.h"
#include "query/traverse/traversal.h"
#include "store/container/announce/chunk_needs.h"

namespace isonest::detail {

/// One byte per cube in Morton order: the Kuhn tetrahedra that are to be refined.
using MaskList = std::vector<std::uint8_t>;

/// Whether the values of the brick's chunk and of those that its last cubes reach into lie on both
/// sides of the isovalue, by the chunk table alone. At the faces of a closed box what is beyond
/// counts. Throws what the chunk source throws.
bool may_hold_surface(const ChunkSource& source, const Int3& brick, double iso, const ClipBox& box);

/// The cubes of level 1 in a brick of level 0 with nodes below the isovalue and nodes not below it;
/// null if there are none. At the faces of a closed box what is beyond counts. Decodes only chunks
/// with values on both sides. Thread-safe. Throws what the chunk source throws.
std::unique_ptr<MaskList> surface_cubes(ChunkCache& cache, const Int3& brick, double iso,
                                        const ClipBox& box);

/// What surface_cubes() decodes: of the brick's chunk and of those that its last cubes reach into
/// the ones with values on both sides. Throws what the chunk source throws.
void add_chunks_on_both_sides(const ChunkSource& source, const Int3& brick, double iso,
                              const ClipBox& box, ChunkNeeds& needs);

}  // namespace isonest::detail
