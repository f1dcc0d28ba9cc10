#include "query/view/indicator_box.h"

#include "query/view/brick_view.h"
#include "query/view/finest_indicators.h"
#include "query/view/topology.h"
#include "store/container/gather.h"

namespace isonest::detail {
namespace {

bool is_in(const Box<double>& box, const Int3& p) {
    return max(p, box.lo) == p && max(p + Int3{1, 1, 1}, box.lo + box.size) == box.lo + box.size;
}

/// Level 1: the cubes' centres are stored, faces and edges follow from the values.
template <class T>
void fill_finest(ChunkCache& cache, Field field, Box<double>& box) {
    const StoreLayout& layout = cache.source().layout();
    const Int3 reach = layout.lattice().cells_at(1) * 2;
    const Int3 last = min(box.lo + box.size - Int3{1, 1, 1}, reach);
    if (max(last, box.lo) != last) {
        return;
    }
    const auto cube_of = [&](const Int3& p) {
        return min({p.x / 2, p.y / 2, p.z / 2}, layout.lattice().elements_at(1) - Int3{1, 1, 1});
    };
    const Int3 first_cube = cube_of(box.lo);
    const Int3 cubes = cube_of(last) - first_cube + Int3{1, 1, 1};
    Box<T> values(first_cube * 2, cubes * 2 + Int3{1, 1, 1});
    gather_values(cache, layout.array(0, Field::values), values);
    const ArrayInfo& array = layout.array(1, field);
    const bool plus = saturation_of(field) == Saturation::plus;
    const bool outward = layout.rounds_outward();
    const Int3 c0 = array.chunk_of(first_cube);
    const Int3 chunks = array.chunk_of(first_cube + cubes - Int3{1, 1, 1}) - c0 + Int3{1, 1, 1};
    for (std::int64_t c = 0; c < chunks.product(); ++c) {
        const Int3 base = array.first_node(c0 + chunks.unlinear(c));
        IndicatorView centres(cache, array, base);
        const Int3 from = max(base, first_cube);
        const Int3 count = min(base + array.chunk, first_cube + cubes) - from;
        for (std::int64_t i = 0; i < count.product(); ++i) {
            const Int3 cube = from + count.unlinear(i);
            // finest_indicator() wants the all-even corner first: mirror the odd cubes.
            const unsigned mirror = mirror_of(cube);
            const CubeValues u = cube_values(values, cube);
            for (int p = 0; p < 27; ++p) {
                const Int3 at = cube * 2 + node_offset(p, mirror);
                const bool refines = ((at.x | at.y | at.z) & 1) != 0;
                if (!refines || !is_in(box, at) || max(at, reach) != reach) {
                    continue;
                }
                const bool centre = slot_of(at) == array.first_slot;
                box.at(at) = centre ? centres.at(cube - base, array.first_slot)
                                    : finest_indicator(u, p, plus, outward);
            }
        }
    }
}

/// The nodes of one level, all of whose slots are stored.
void fill_level(ChunkCache& cache, const ArrayInfo& array, Box<double>& box) {
    const std::int64_t scale = std::int64_t{1} << (array.level - 1);
    const Int3 scales{scale, scale, scale};
    const Int3 reach = cache.source().layout().lattice().cells_at(array.level) * 2;
    // In units of the scale.
    const Int3 first = ceil_div(box.lo, scales);
    const Int3 end = min(ceil_div(box.lo + box.size, scales), reach + Int3{1, 1, 1});
    if (min(end - first, {1, 1, 1}) != Int3{1, 1, 1}) {
        return;
    }
    const auto owner_of = [](const Int3& p) { return Int3{p.x / 2, p.y / 2, p.z / 2}; };
    const Int3 c0 = array.chunk_of(owner_of(first));
    const Int3 chunks = array.chunk_of(owner_of(end - Int3{1, 1, 1})) - c0 + Int3{1, 1, 1};
    for (std::int64_t c = 0; c < chunks.product(); ++c) {
        const Int3 base = array.first_node(c0 + chunks.unlinear(c));
        IndicatorView view(cache, array, base);
        const Int3 from = max(base * 2, first);
        const Int3 count = min((base + array.chunk) * 2, end) - from;
        for (std::int64_t i = 0; i < count.product(); ++i) {
            const Int3 p = from + count.unlinear(i);
            if (((p.x | p.y | p.z) & 1) != 0) {
                box.at(p * scale) = view.at(owner_of(p) - base, slot_of(p));
            }
        }
    }
}

}  // namespace

void fill_indicators(ChunkCache& cache, Field field, int level, Box<double>& box) {
    const StoreLayout& layout = cache.source().layout();
    const int top = layout.lattice().top();
    const bool derived = centre_suffices_at_level_1(field);
    if (derived && level <= 1 && top >= 1) {
        dispatch(layout.header().type,
                 [&](auto tag) { fill_finest<typename decltype(tag)::type>(cache, field, box); });
    }
    for (int l = std::max(level, derived ? 2 : 1); l <= top; ++l) {
        fill_level(cache, layout.array(l, field), box);
    }
}

}  // namespace isonest::detail
