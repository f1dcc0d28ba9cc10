#include "query/surface_nets/make_net.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "store/base/workers.h"
#include "store/container/announce/announcer.h"

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

/// The chunks that a block of cells reads: those of its nodes but where all have one label.
void want_block(const StoreReader& store, const Int3& lo, const Int3& hi, std::int64_t halo,
                std::vector<WantedChunk>& chunks) {
    const Int3 around{halo + 2, halo + 2, halo + 2};
    std::vector<WantedChunk> all;
    want_box(store.layout().array(0, Field::values), lo - around, hi + around - Int3{1, 1, 1}, all);
    std::copy_if(all.begin(), all.end(), std::back_inserter(chunks), [&](const WantedChunk& c) {
        const ChunkRow row = store.row(*c.array, c.chunk);
        return row.min != row.max || row.flags != 0;
    });
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
        const auto first_of = [&](std::size_t i) {
            return plan.first_cell(plan.blocks.unlinear(blocks[i]));
        };
        tbb::enumerable_thread_specific<NetBlock> workers(
            [&] { return NetBlock(setting, cache, name); });
        const auto make = [&](std::size_t i) {
            progress.check();
            const Int3 lo = first_of(i);
            workers.local().make(lo, min(lo + plan.block, plan.hi), [&](const NetPiece& piece) {
                progress.check();
                net.append(piece);
            });
            progress.advance(1);
        };
        if (store.is_far()) {
            const auto count = static_cast<std::int64_t>(blocks.size());
            Announcer announcer(cache, 0, count,
                                [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                                    const Int3 lo = first_of(static_cast<std::size_t>(i));
                                    const Int3 hi = min(lo + plan.block, plan.hi);
                                    want_block(store, lo, hi, setting.halo(), chunks);
                                });
            for_each_announced(store, announcer, 0, count,
                               [&](std::int64_t i) { make(static_cast<std::size_t>(i)); });
            return;
        }
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, blocks.size(), 1),
            [&](const tbb::blocked_range<std::size_t>& range) {
                for (std::size_t i = range.begin(); i < range.end(); ++i) {
                    make(i);
                }
            },
            tbb::simple_partitioner{});
    });
    net.seal();
    return {blocks.size(), cache.chunks_read(), cache.bytes_read(), cache.peak_bytes()};
}

}  // namespace isonest::detail
