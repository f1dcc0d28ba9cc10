// The surface at full resolution: the result of AdaptTraverse if no node stops, in a brick of level
// 0, from the values alone.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 1 and 2 with epsilon = 0: every element of
// interest is refined to the finest grid, so the coarser levels and their indicators are not read.
// Elements are tetrahedra or hexahedral cells:
// - the tetrahedra of a cube, all at once by a table or one by one;
// - the cube as one hexahedral cell.
#pragma once

#include <memory>

#include <isonest/int3.h>

#include "query/march/clip.h"
#include "query/traverse/traversal.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

// Whether a brick of level 0 can contain surface that faces the viewer, before its values are read.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: beta_1 or beta_N of an element can prove that
// all of its descendants face away. Here the elements are the six of each cube of 8^3 cells, and
// the number is that of the cube's centre, which covers the whole cube. Values and bounds of that
// level are less than a hundredth of those of the finest level.

/// Checks the brick's cubes of level 3, except those whose ranges exclude the isovalue: first only
/// the gradients of that level, and the bounds only if all of those face away. Returns true if
/// there is no such level. Counts the tetrahedra that it tests. REQUIRES: the query culls.
/// Thread-safe. Throws what the chunk cache throws.
bool may_face_viewer(TraversalRun& run, const Int3& brick);

/// Adds the chunks that may_face_viewer() may read.
void add_facing_needs(const TraversalRun& run, const Int3& brick, ChunkNeeds& needs);

// Which cubes of a brick of level 0 intersect the isosurface of the data.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5, the interest test with beta_0 = 0, which is
// valid where nothing is left to refine: first by the smallest and largest value of each chunk,
// then by the values. Without a tolerance every node refines, so the coarser levels are not needed.

/// One byte per cube in Morton order: the Kuhn tetrahedra to be refined.
using MaskList = std::vector<std::uint8_t>;
/// Cubes of a brick's parent level, or a part of them (a range in Morton order).
struct Parents {
    MaskList masks;
    std::size_t begin = 0;
};
/// For each run; null if it has no work here. Empty for the root.
using ParentsOfRuns = std::vector<std::unique_ptr<Parents>>;

/// Whether the values of the brick's chunk and of the neighbours that its last cubes use lie on
/// both sides of the isovalue, by the chunk table alone. At the faces of a closed box the outside
/// is included. Throws what the chunk source throws.
bool may_hold_surface(const ChunkSource& source, const Int3& brick, double iso, const ClipBox& box);

/// The cubes of level 1 in a brick of level 0 that have nodes below the isovalue and nodes not
/// below it; null if there are none. At the faces of a closed box the outside is included. Decodes
/// only chunks with values on both sides. Thread-safe. Throws what the chunk source throws.
std::unique_ptr<MaskList> surface_cubes(ChunkCache& cache, const Int3& brick, double iso,
                                        const ClipBox& box);

/// Adds the chunks that surface_cubes() decodes: those with values on both sides, among the brick's
/// chunk and the neighbours that its last cubes use. Throws what the chunk source throws.
void add_chunks_on_both_sides(const ChunkSource& source, const Int3& brick, double iso,
                              const ClipBox& box, ChunkNeeds& needs);

/// Marches all cubes of a brick that intersect the isosurface of the data or a cap of a closed box,
/// as the query's type of cells. `cubes`: cubes of level 1, from surface_cubes(). Elements with a
/// missing value at a corner contain neither. REQUIRES: the query has no plane; for hexahedra
/// neither culling nor on_leaf. Throws what the chunk source and the sink throw.
void march_finest_brick(TraversalRun& run, const Int3& brick, const MaskList& cubes);

}  // namespace isonest::detail
