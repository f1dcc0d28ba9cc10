// The blocks that make a level from those below.
#pragma once

#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/finer_levels.h"
#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/pass_context.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Number of blocks per axis of the pass that makes level `level` >= 3.
Int3 coarse_grid(const StoreLayout& layout, int level);
/// Values of level - 1 and indicators of `level`; reads values of level - 2 from `finer`.
template <class T>
std::vector<EncodedChunk> coarse_block(const PassContext& context, FinerLevels& finer, int level,
                                       const Int3& block);

/// The values of the coarsest level, from those of the level below.
template <class T>
std::vector<EncodedChunk> top_values(const PassContext& context, FinerLevels& finer);

}  // namespace isonest::detail
