// A part of a slab's surface, ready to be welded to others.
#pragma once

#include <cstddef>

#include "query/march/mesh_part.h"
#include "query/slabs/marched_slab.h"

namespace isonest::detail {

/// Bytes of heap that a part takes for each unit of its weight until it is put away: it is there
/// up to three times, vectors have room for more, and vertices in nodes have a table.
inline constexpr std::size_t kBytesPerPartWeight = 480;

/// The part with its vertices in the order in which triangles first name them, attributes being the
/// normals if there are any. REQUIRES: `shared` has the names.
MeshPart part_of(MarchedSlab&& slab);

}  // namespace isonest::detail
