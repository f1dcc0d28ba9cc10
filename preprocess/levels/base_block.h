// The blocks that take in the volume and make levels 0 to 2.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/sources/wrapping/plane_window.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Number of base blocks per axis; block c covers nodes 2K c to 2K (c + 1) - 1, K being the chunk.
Int3 base_grid(const StoreLayout& layout);
/// Planes of the volume that the blocks with this z need: [first, second).
std::pair<std::int64_t, std::int64_t> base_planes(const StoreLayout& layout, std::int64_t z);
/// Levels 0 to 2 of one base block: values of 0 and 1, indicators of 1 and 2.
template <class T>
std::vector<EncodedChunk> base_block(const PassContext& context, const PlaneWindow& window,
                                     const Int3& block);

}  // namespace isonest::detail
