// Keeps the vertices of a welded mesh apart whose parts several ranks have, with the result of
// keep_parts_apart() where all parts are in one process.
//
//     home of a place    which vertices are together in it; places have homes by their hash
//     rank 0             moves them: it gets those that may be together, with the triangles that
//                        touch those that are
//     homes              tell the ranks whose parts have a vertex where it is now
//
// If no two vertices are in one place, rank 0 does nothing.
#pragma once

#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// `range`: of rank 0, with the mesh's box; must not be turned. What grows with the mesh lies in
/// temporary files in `folder`; rank 0's are those of keep_parts_apart(). Returns on rank 0 what
/// was moved, elsewhere nothing. REQUIRES: PartStore::watch() was called, and no triangle of any
/// rank is without area. Collective. Throws Error{io, cancelled}.
ApartVertices keep_apart_on_ranks(Communicator& ranks, PartStore& parts, const VertexNumbers& weld,
                                  const ApartRange& range, const ScratchFolder& folder,
                                  Progress& progress);

}  // namespace isonest::detail
