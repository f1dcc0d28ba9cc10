#include "query/surface_nets/make_net.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>
#include <vector>

#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::array<std::int64_t, 7> kEdges{32, 64, 96, 128, 160, 192, 256};
/// Number of blocks per thread, so that no thread is idle for long at the end.
constexpr std::int64_t kBlocksEach = 4;
constexpr std::int64_t kMinDepth = 64;

/// Heap of one thread.
std::uint64_t heap_of(const NetSetting& setting, const ArrayInfo& array, std::int64_t edge) {
    return NetBlock::heap(setting, array, edge) + decode_heap(array.chunk_bytes());
}

std::int64_t rounded_up(std::int64_t a, std::int64_t to) {
    return ceil_div(a, to) * to;
}

/// Size of equal blocks for `cells`: as many blocks as `edge` requires.
std::int64_t even(std::int64_t cells, std::int64_t edge, std::int64_t piece) {
    return rounded_up(ceil_div(cells, ceil_div(cells, edge)), piece);
}

}  // namespace

NetPlan net_plan(const NetSetting& setting, const ArrayInfo& array, const Int3& lo, const Int3& hi,
                 const MemoryShare& memory) {
    memory.require(heap_of(setting, array, kEdges.front()), "smoothing its labels");
    const std::uint64_t usable = memory.left();
    NetPlan plan;
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t piece = kPieceCells[axis];
        plan.lo[axis] = lo[axis] / piece * piece;
        plan.hi[axis] = std::min(rounded_up(hi[axis], piece), setting.cells()[axis]);
    }
    const Int3 size = plan.hi - plan.lo;
    double best = 0;
    for (const std::int64_t edge : kEdges) {
        const Int3 block{even(size.x, edge, kPieceCells.x), even(size.y, edge, kPieceCells.y), 0};
        const std::uint64_t each = heap_of(setting, array, std::max(block.x, block.y));
        if (each > usable) {
            continue;
        }
        const auto most = std::min(usable / each, static_cast<std::uint64_t>(memory.threads()));
        const auto halo = static_cast<double>(2 * setting.halo());
        const double work =
            (1 + halo / static_cast<double>(block.x)) * (1 + halo / static_cast<double>(block.y));
        if (static_cast<double>(most) / work > best) {
            best = static_cast<double>(most) / work;
            plan.threads = static_cast<int>(most);
            plan.block = block;
            plan.cache = usable - most * each;
        }
    }
    const std::int64_t columns = ceil_div(size.x, plan.block.x) * ceil_div(size.y, plan.block.y);
    const std::int64_t layers =
        std::clamp<std::int64_t>(ceil_div(kBlocksEach * plan.threads, columns), 1,
                                 std::max<std::int64_t>(size.z / kMinDepth, 1));
    plan.block.z = even(size.z, ceil_div(size.z, layers), kPieceCells.z);
    plan.blocks = ceil_div(size, plan.block);
    return plan;
}

namespace {

/// Numbers of the blocks that contain parts of a label.
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

/// The chunks that a block of cells reads: those of its nodes, except chunks with a single label.
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
        if (store.is_remote()) {
            const auto count = static_cast<std::int64_t>(blocks.size());
            Prefetcher prefetcher(cache, 0, count,
                                  [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                                      const Int3 lo = first_of(static_cast<std::size_t>(i));
                                      const Int3 hi = min(lo + plan.block, plan.hi);
                                      want_block(store, lo, hi, setting.halo(), chunks);
                                  });
            for_each_prefetched(store, prefetcher, 0, count,
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
