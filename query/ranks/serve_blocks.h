// The side of the ranks that have no mesh when all map blocks: query/ranks/rank_mapping.h.
#pragma once

#include <string>

#include <isonest/extract.h>
#include <isonest/progress.h>

#include "query/ranks/rank_team.h"

namespace isonest::detail {

/// After rank 0 has broadcast kBlocksToMap: maps the blocks that its RankMapping sends until that
/// is finished, with the threads and within the memory of `options`: a quarter is for blocks that
/// wait. `name`: of the volume, for errors. Collective. REQUIRES: `team` is not rank 0's. Throws
/// Error{cancelled} if another rank has failed, Error{limit} if the memory holds no block.
void serve_blocks(RankTeam& team, const std::string& name, const ExtractOptions& options,
                  const Progress& progress);

}  // namespace isonest::detail
