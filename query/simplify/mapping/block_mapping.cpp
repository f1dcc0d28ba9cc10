#include "query/simplify/mapping/block_mapping.h"

#include <oneapi/tbb/task_arena.h>

#include "store/base/in_order.h"

namespace isonest::detail {

void LocalMapping::map(const BlockPass& pass, Progress& progress) {
    in_order(
        pass.blocks, tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress.check();
            MappedBlock block = pass.load(i);
            const std::size_t count = block.patch.triangles.size();
            block.gone_at = map_patch(block.patch, pass.limits);
            progress.advance(count);
            return block;
        },
        pass.use);
}

}  // namespace isonest::detail
