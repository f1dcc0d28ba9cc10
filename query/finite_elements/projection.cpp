#include "query/finite_elements/projection.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

namespace isonest::detail {
namespace {

constexpr std::int64_t kRowsPerTask = 64;

template <class F>
void for_rows(std::int64_t rows, const F& f) {
    tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, rows, kRowsPerTask), [&](const auto& r) {
        for (std::int64_t row = r.begin(); row < r.end(); ++row) {
            f(row);
        }
    });
}

/// The inactive refinement nodes of one slot, from the nodes of coarser levels.
void prolong_slot(const Lattice& lattice, const NodeSet& set, int level, int slot,
                  std::span<float> all) {
    const Int3 nodes = lattice.nodes();
    const std::int64_t scale = std::int64_t{1} << (level - 1);
    const Int3 odd = slot_offset(slot);
    Int3 count;
    for (int axis = 0; axis < 3; ++axis) {
        const std::int64_t last = nodes[axis] - 1 - odd[axis] * scale;
        count[axis] = last < 0 ? 0 : last / (2 * scale) + 1;
    }
    for_rows(count.y * count.z, [&](std::int64_t row) {
        for (std::int64_t i = 0; i < count.x; ++i) {
            const Int3 p = (Int3{i, row % count.y, row / count.y} * 2 + odd) * scale;
            if (set.contains(p)) {
                continue;
            }
            const NodeInfo node = describe_node(p, lattice.top());
            const auto at = [&](const Int3& q) {
                return all[static_cast<std::size_t>(nodes.linear(q))];
            };
            all[static_cast<std::size_t>(nodes.linear(p))] =
                0.5F * at(node.end0) + 0.5F * at(node.end1);
        }
    });
}

}  // namespace

void restrict_to(const NodeSet& set, std::span<const float> all, std::span<float> active) {
    const Int3 nodes = set.nodes();
    for_rows(nodes.y * nodes.z, [&](std::int64_t row) {
        const float* const from = all.data() + row * nodes.x;
        set.for_row({0, row % nodes.y, row / nodes.y}, nodes.x,
                    [&](std::int64_t x, std::uint64_t number) { active[number] = from[x]; });
    });
}

void prolong(const Lattice& lattice, const NodeSet& set, std::span<const float> active,
             std::span<float> all) {
    const Int3 nodes = set.nodes();
    for_rows(nodes.y * nodes.z, [&](std::int64_t row) {
        float* const to = all.data() + row * nodes.x;
        set.for_row({0, row % nodes.y, row / nodes.y}, nodes.x,
                    [&](std::int64_t x, std::uint64_t number) { to[x] = active[number]; });
    });
    if (set.is_full()) {
        return;
    }
    for (int level = lattice.top(); level >= 1; --level) {
        for (int slot = 0; slot < kSlots; ++slot) {
            if ((static_cast<unsigned>(slot + 1) & lattice.flat_axes()) == 0) {
                prolong_slot(lattice, set, level, slot, all);
            }
        }
    }
}

}  // namespace isonest::detail
