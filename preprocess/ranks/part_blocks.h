// Blocks of coarser levels in parts: each rank computes what lies on its own pencils of the base
// pass, and whoever has a block puts its chunks together.
#pragma once

#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/partial_levels.h"

namespace isonest::detail {

/// The cubes of a part of a pass: `count` per axis from `first` on, as far as there are any. Their
/// values and indicators go to `levels`, as stored, their centres to those of `context`.
/// Thread-safe for different parts.
template <class T>
void compute_part(const PassContext& context, PartialLevels& levels, int pass, const Int3& first,
                  const Int3& count);

/// The chunks of a block, from the rows in `levels`. Thread-safe.
template <class T>
std::vector<EncodedChunk> assemble_block(const StoreLayout& layout, const PartialLevels& levels,
                                         int pass, const Int3& block);

}  // namespace isonest::detail
