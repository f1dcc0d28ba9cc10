// Which rank traverses what.
//
// The finest cells in Morton order are cut into ranges with about as many cubes of 8^3 cells in
// each in which the chunk table and the stored ranges allow surface. They are counted in groups,
// each by one rank, so that no rank reads all of the tables, and the counts are not more for larger
// volumes.
#pragma once

#include <span>

#include "query/traverse/traversal.h"
#include "store/container/chunk_source.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// This rank's share. `isovalues`: in place of query.iso; of a query with a plane they mean
/// nothing. Every cell is one rank's. Collective. Throws Error{cancelled}, and what the source
/// throws but for damage, which whoever needs the chunk will find.
CubeShare share_of(Communicator& ranks, const ChunkSource& source, const TraversalQuery& query,
                   std::span<const double> isovalues);

}  // namespace isonest::detail
