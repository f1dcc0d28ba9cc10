// Which rank traverses what.
//
// The bricks of level 0 in Morton order are cut into ranges with about the same number of bricks in
// which the chunk table allows surface. Groups of bricks are counted, each by one rank, so that
// no rank reads the whole table, and the counts are as many for any volume.
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
