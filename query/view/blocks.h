// Small boxes of a large one, in an order that asks for few chunks at a time.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// Edge of the boxes that for_each_block() makes unless told otherwise.
inline constexpr std::int64_t kBlockEdge = 32;

/// Calls f(lo, size) for boxes of at most `edge` nodes per axis that fill the box of `size` nodes
/// from `lo` on, chunk by chunk of `chunk` nodes counted from `lo`: so each is asked for in one go.
template <class F>
void for_each_block(const Int3& lo, const Int3& size, const Int3& chunk, const F& f,
                    std::int64_t edge = kBlockEdge) {
    const Int3 edges{edge, edge, edge};
    const Int3 chunks = ceil_div(size, chunk);
    for (std::int64_t c = 0; c < chunks.product(); ++c) {
        const Int3 i = chunks.unlinear(c);
        const Int3 first{i.x * chunk.x, i.y * chunk.y, i.z * chunk.z};
        const Int3 all = min(chunk, size - first);
        const Int3 blocks = ceil_div(all, edges);
        for (std::int64_t b = 0; b < blocks.product(); ++b) {
            const Int3 from = blocks.unlinear(b) * edge;
            f(lo + first + from, min(edges, all - from));
        }
    }
}

}  // namespace isonest::detail
