#include "query/finite_elements/projection.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "query/finite_elements/slot_rows.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kRowsInOneGo = 64;

template <class F>
void for_rows(std::int64_t rows, const F& f) {
    tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, rows, kRowsInOneGo), [&](const auto& r) {
        for (std::int64_t row = r.begin(); row < r.end(); ++row) {
            f(row);
        }
    });
}

/// The inactive refinement nodes of one slot, from the nodes of coarser levels.
void prolong_slot(const Lattice& lattice, const NodeSet& set, int level, int slot,
                  std::span<float> all) {
    const Int3 nodes = lattice.nodes();
    const SlotRows slot_rows(lattice, level, slot);
    for_rows(slot_rows.rows(), [&](std::int64_t row) {
        const Int3 first = slot_rows.first_of(row);
        const Int3 half = slot_rows.half_edge(0, first);
        const auto from = [&](std::int64_t y, std::int64_t z) {
            return all.data() + nodes.linear({0, y, z});
        };
        const std::span<const std::uint64_t> active = set.row_words(first.y, first.z);
        float* const to = from(first.y, first.z);
        const float* const end0 = from(first.y - half.y, first.z - half.z);
        const float* const end1 = from(first.y + half.y, first.z + half.z);
        for (std::int64_t i = 0, x = first.x; i < slot_rows.count.x;
             ++i, x += 2 * slot_rows.scale) {
            if ((active[static_cast<std::size_t>(x / 64)] >> static_cast<unsigned>(x % 64) & 1U) ==
                0) {
                const std::int64_t by = i % 2 != 0 ? -half.x : half.x;
                to[x] = 0.5F * end0[x - by] + 0.5F * end1[x + by];
            }
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
