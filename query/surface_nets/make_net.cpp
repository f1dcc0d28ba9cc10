#include "query/surface_nets/make_net.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// Numbers of blocks that a label reaches.
std::vector<std::int64_t> reached_blocks(const NetPlan& plan, std::span<const Label> labels) {
    std::vector<bool> reached(static_cast<std::size_t>(plan.blocks.product()));
    for (const Label& label : labels) {
        const auto [lo, hi] = cells_of_label(label);
        const Int3 from = max(lo, plan.lo) - plan.lo;
        const Int3 to = min(hi, plan.hi) - Int3{1, 1, 1} - plan.lo;
        for (std::int64_t z = from.z / plan.block.z; z <= to.z / plan.block.z; ++z) {
            for (std::int64_t y = from.y / plan.block.y; y <= to.y / plan.block.y; ++y) {
                for (std::int64_t x = from.x / plan.block.x; x <= to.x / plan.block.x; ++x) {
                    reached[static_cast<std::size_t>(plan.blocks.linear({x, y, z}))] = true;
                }
            }
        }
    }
    std::vector<std::int64_t> numbers;
    for (std::size_t i = 0; i < reached.size(); ++i) {
        if (reached[i]) {
            numbers.push_back(static_cast<std::int64_t>(i));
        }
    }
    return numbers;
}

}  // namespace

std::pair<Int3, Int3> cells_of_label(const Label& label) {
    return {label.low, label.high + Int3{2, 2, 2}};
}

NetCounts make_net(const StoreReader& store, const NetSetting& setting, const NetPlan& plan,
                   std::span<const Label> labels, NetStore& net, Progress& progress) {
    const std::vector<std::int64_t> blocks = reached_blocks(plan, labels);
    const std::string name = store.path().string();
    ChunkCache cache(store, plan.cache);
    progress.begin("extract", blocks.size(), "blocks");
    Workers(plan.threads).execute([&] {
        tbb::enumerable_thread_specific<NetBlock> workers(
            [&] { return NetBlock(setting, cache, name); });
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, blocks.size(), 1),
            [&](const tbb::blocked_range<std::size_t>& range) {
                for (std::size_t i = range.begin(); i < range.end(); ++i) {
                    progress.check();
                    const Int3 lo = plan.first_cell(plan.blocks.unlinear(blocks[i]));
                    workers.local().make(lo, min(lo + plan.block, plan.hi),
                                         [&](const NetPiece& piece) {
                                             progress.check();
                                             net.append(piece);
                                         });
                    progress.advance(1);
                }
            },
            tbb::simple_partitioner{});
    });
    net.seal();
    return {blocks.size(), cache.chunks_read(), cache.bytes_read(), cache.peak_bytes()};
}

}  // namespace isonest::detail
