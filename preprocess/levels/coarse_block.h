// The blocks that make a level from those below.
#pragma once

#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/finer_levels.h"
#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Number of blocks per axis of the pass that makes level `level` >= 3.
Int3 coarse_grid(const StoreLayout& layout, int level);
/// The values two levels finer that `count` cubes of a level per axis, from `first` on, need, as
/// far as there are cubes.
template <class T>
ValueBox<T> coarse_values(const StoreLayout& layout, FinerLevels& finer, int level,
                          const Int3& first, const Int3& count);
/// The indicators of these cubes' nodes go to `sink`, and their centres to the coarser levels.
/// `box`: of coarse_values().
template <class T>
void coarse_indicators(const PassContext& context, FinerLevels& finer, int level, const Int3& first,
                       const Int3& count, const ValueBox<T>& box, LevelSink& sink);

/// Values of level - 1 and indicators of `level`; reads values of level - 2 from `finer`.
template <class T>
std::vector<EncodedChunk> coarse_block(const PassContext& context, FinerLevels& finer, int level,
                                       const Int3& block);

/// The values of the coarsest level, from those of the level below.
template <class T>
std::vector<EncodedChunk> top_values(const PassContext& context, FinerLevels& finer);

}  // namespace isonest::detail
