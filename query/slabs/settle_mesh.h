// What is done to a marched mesh as a whole, as stages do it to the mesh of a store.
#pragma once

#include <isonest/extract_report.h>
#include <isonest/march.h>
#include <isonest/progress.h>

#include "query/slabs/join_slabs.h"

namespace isonest::detail {

/// Mends triangles without area, in another room, keeps vertices apart that are in one place, and
/// gives a normal to those that have none.
/// What it finds and changes is in the report, which has to have all else of `joined`. Throws
/// Error{io, cancelled}, and what `make_room` throws.
void settle_mesh(const JoinedMesh& joined, const MeshLayout& layout, const MakeRoom& make_room,
                 const VolumeDescription& volume, const ExtractOptions& options,
                 ExtractReport& report, Progress& progress);

}  // namespace isonest::detail
