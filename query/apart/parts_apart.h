// Keeps the vertices of a welded mesh apart, in its parts.
#pragma once

#include <optional>

#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// `range`: its box is not looked at, that of the parts holds. What grows with the mesh lies in
/// temporary files in `folder`. REQUIRES: PartStore::watch() was called, and no triangle is without
/// area. Throws Error{io, cancelled}.
ApartVertices keep_parts_apart(PartStore& parts, const Weld& weld, ApartRange range,
                               const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
