// The side of the ranks that have no mesh when all map blocks: query/ranks/rank_mapping.h.
#pragma once

#include <string>

#include <isonest/extract.h>
#include <isonest/progress.h>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What a rank did for the blocks of others.
struct ServedBlocks {
    std::uint64_t blocks = 0;
    std::uint64_t triangles = 0;  ///< that they had before
    double seconds = 0;           ///< in which it mapped them
};

/// After rank 0 has broadcast kBlocksToMap: maps the blocks that its RankMapping sends until that
/// is finished, with the threads and within the memory of `options`: a quarter is for blocks that
/// wait. `name`: of the volume, for errors. Collective. REQUIRES: `ranks` is not rank 0's. Throws
/// Error{cancelled} if another rank has failed, Error{limit} if the memory holds no block.
ServedBlocks serve_blocks(Communicator& ranks, const std::string& name,
                          const ExtractOptions& options, const Progress& progress);

}  // namespace isonest::detail
