#include "query/surface_nets/net_plan.h"

#include <algorithm>
#include <array>

#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::array<std::int64_t, 7> kEdges{32, 64, 96, 128, 160, 192, 256};
/// Blocks for each thread, so that none is idle for long at the end.
constexpr std::int64_t kBlocksEach = 4;
constexpr std::int64_t kLeastDepth = 64;

/// Heap of one thread.
std::uint64_t heap_of(const NetSetting& setting, const ArrayInfo& array, std::int64_t edge) {
    return NetBlock::heap(setting, array, edge) + decode_heap(array.chunk_bytes());
}

std::int64_t rounded_up(std::int64_t a, std::int64_t to) {
    return ceil_div(a, to) * to;
}

/// `cells` in as many equal blocks as `edge` needs.
std::int64_t even(std::int64_t cells, std::int64_t edge, std::int64_t piece) {
    return rounded_up(ceil_div(cells, ceil_div(cells, edge)), piece);
}

}  // namespace

NetPlan net_plan(const NetSetting& setting, const ArrayInfo& array, const Int3& lo, const Int3& hi,
                 std::uint64_t memory, int threads, const std::string& store) {
    require_memory(store, memory, kLibraryHeap + heap_of(setting, array, kEdges.front()),
                   "smoothing its labels");
    const std::uint64_t usable = memory - kLibraryHeap;
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
        const auto most =
            std::min(usable / each, static_cast<std::uint64_t>(Workers::count_of(threads)));
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
                                 std::max<std::int64_t>(size.z / kLeastDepth, 1));
    plan.block.z = even(size.z, ceil_div(size.z, layers), kPieceCells.z);
    plan.blocks = ceil_div(size, plan.block);
    return plan;
}

}  // namespace isonest::detail
