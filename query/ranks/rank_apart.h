// Separates the vertices of a welded mesh whose parts are on several ranks, with the same result as
// keep_parts_apart() where all parts are in one process.
//
//     home of a place    determines which vertices are together in it; the home is given by a hash
//     rank 0             moves them: it gets those that may be together, and the triangles at
//                        those that are
//     homes              send new positions to the ranks whose parts have the vertex
//
// If no two vertices are at the same place, rank 0 does nothing.
#pragma once

#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// `range`: on rank 0, with the mesh's box; must not be rotated. Data that grows with the mesh is
/// kept in temporary files in `folder`; those of rank 0 are as for keep_parts_apart(). Returns the
/// moved vertices on rank 0, nothing elsewhere. REQUIRES: PartStore::watch() was called, and no
/// triangle of any rank is without area. Collective. Throws Error{io, cancelled}.
ApartVertices keep_apart_on_ranks(Communicator& ranks, PartStore& parts, const VertexNumbers& weld,
                                  const ApartRange& range, const ScratchFolder& folder,
                                  Progress& progress);

}  // namespace isonest::detail
