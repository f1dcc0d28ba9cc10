#include "query/values/node_sampler.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <vector>

#include <isonest/error.h>

#include "query/values/brick_view.h"
#include "query/values/node_fields.h"
#include "query/values/topology.h"
#include "store/container/chunk_cache.h"
#include "store/lattice/children.h"

namespace isonest::detail {

void NodeSampler::enter(int level, const Int3& node) {
    home_level_ = level;
    const std::int64_t stride = std::int64_t{1} << level;
    home_chunk_ = layout_->array(level, Field::values)
                      .chunk_of({node.x / stride, node.y / stride, node.z / stride});
}

void NodeSampler::leave() {
    home_level_.reset();
    home_ = {};
    values_ = {};
    indicators_ = {};
}

bool NodeSampler::is_home(const ArrayInfo& array, const Int3& chunk) const {
    return array.field == Field::values && home_level_ == array.level && chunk == home_chunk_;
}

const std::byte* NodeSampler::element(Recent& recent, const Int3& node, int component) {
    const ArrayInfo& array = *recent.array;
    Int3 p = node - recent.first;
    const bool near = recent.chunk.x >= 0 && min(p, {0, 0, 0}) == Int3{0, 0, 0} &&
                      p.x < array.chunk.x && p.y < array.chunk.y && p.z < array.chunk.z;
    const Int3 chunk = near ? recent.chunk : array.chunk_of(node);
    if (!near) {
        p = node - array.first_node(chunk);
    }
    const bool home = is_home(array, chunk);
    Recent& from = home ? home_ : recent;
    const std::byte* at = chunk == from.chunk ? cache_->find(array, from.part, p) : nullptr;
    if (at == nullptr) {
        const bool whole = home || !home_level_;
        from = {};
        from.array = &array;
        from.chunk = chunk;
        from.first = array.first_node(chunk);
        from.part =
            whole ? ChunkPart{cache_->get(array, chunk), true} : cache_->part(array, chunk, p);
        if (from.part.is_whole) {
            const auto each =
                static_cast<std::int64_t>(array.codec.element_size) * array.components;
            from.whole = from.part.data.get();
            from.size = min(array.chunk, array.nodes - from.first);
            from.bytes = {each, each * array.chunk.x, each * array.chunk.x * array.chunk.y};
        }
        at = cache_->find(array, from.part, p);
    }
    return at + static_cast<std::size_t>(component) * array.codec.element_size;
}

double NodeSampler::value(const Int3& p, int level) {
    const int from = std::min(level, top_);
    Recent& recent = values_[static_cast<std::size_t>(from)];
    const Int3 place{p.x >> from, p.y >> from, p.z >> from};
    const std::byte* at = recent.find(place);
    if (at == nullptr) {
        look_at(recent, from, Field::values);
        const Int3 last = recent.array->nodes - Int3{1, 1, 1};
        at = element(recent, max({0, 0, 0}, min(place, last)), 0);
    }
    return dispatch(type_, [&](auto tag) {
        return static_cast<double>(*reinterpret_cast<const typename decltype(tag)::type*>(at));
    });
}

Double3 NodeSampler::gradient(const Int3& p, int level) {
    const std::int64_t stride = std::int64_t{1} << level;
    const Int3 last = layout_->lattice().nodes_at(level) - Int3{1, 1, 1};
    Double3 g{};
    for (int axis = 0; axis < 3; ++axis) {
        Int3 low = p;
        Int3 high = p;
        low[axis] = std::max<std::int64_t>(p[axis] - stride, 0);
        high[axis] = std::min(p[axis] + stride, last[axis] * stride);
        if (low[axis] == high[axis]) {
            continue;
        }
        const auto a = static_cast<std::size_t>(axis);
        g[a] = (value(high, level) - value(low, level)) / steps_.between(a, low[axis], high[axis]);
    }
    return steps_.gradient(g);
}

namespace {

/// The indicator at a node of level 1 from the values of the finest level, read(node). `x` has odd
/// coordinates; `plus`, `outward`, `flat`: as for finest_offset() and child_offsets().
template <class Read>
double number_at_level_1(const Int3& x, bool plus, bool outward, unsigned flat, const Read& read) {
    // The offset of a node from the ends of its refinement edge (describe_node()).
    const auto offset_of = [&](const Int3& p) {
        const auto along = [](std::int64_t at) {
            return (at & 1) == 0 ? 0 : (at & 3) == 1 ? 1 : -1;
        };
        const Int3 half{along(p.x), along(p.y), along(p.z)};
        return finest_offset(read(p), read(p - half), read(p + half), outward);
    };
    const double eta = offset_of(x);
    const auto odd = static_cast<unsigned>((x.x & 1) | (x.y & 1) << 1 | (x.z & 1) << 2);
    if (std::popcount(odd) == 1) {
        return eta;
    }
    double largest = 0;
    for (const Int3& offset : child_offsets(odd, flat)) {
        largest = std::max(largest, offset_of(x + offset));
    }
    return plus ? eta + largest : std::max(eta, largest);
}

}  // namespace

double NodeSampler::at_level_1(const Int3& x, bool plus) {
    if (computed_.empty()) {
        computed_.resize(kComputed);
    }
    static_assert(3 * (kLevels - 1) < 64);
    const auto bits = [](std::int64_t p, unsigned shift) {
        return static_cast<std::uint64_t>(p) << shift;
    };
    // A node that refines an element has an odd coordinate, so no key is 0.
    const std::uint64_t key =
        bits(x.x, 0) | bits(x.y, 21) | bits(x.z, 42) | (plus ? std::uint64_t{1} << 63U : 0);
    // The nodes of a cube of 16^3 have different places.
    Computed& entry =
        computed_[static_cast<std::size_t>((x.x & 15) | (x.y & 15) << 4 | (x.z & 15) << 8)];
    if (entry.key != key) {
        entry = {key, computed_at_level_1(x, plus)};
    }
    return entry.number;
}

double NodeSampler::computed_at_level_1(const Int3& x, bool plus) {
    const unsigned flat = layout_->lattice().flat_axes();
    const Recent& recent = values_[0];
    const std::byte* first = recent.find(x - Int3{1, 1, 1});
    if (first == nullptr || recent.find(x + Int3{1, 1, 1}) == nullptr) {
        return number_at_level_1(x, plus, outward_, flat,
                                 [this](const Int3& p) { return value(p, 0); });
    }
    // All these nodes are in the chunk.
    const std::byte* middle = first + (recent.bytes.x + recent.bytes.y + recent.bytes.z);
    return dispatch(type_, [&](auto tag) {
        return number_at_level_1(x, plus, outward_, flat, [&](const Int3& p) {
            const Int3 d = p - x;
            return static_cast<double>(*reinterpret_cast<const typename decltype(tag)::type*>(
                middle + (d.x * recent.bytes.x + d.y * recent.bytes.y + d.z * recent.bytes.z)));
        });
    });
}

double NodeSampler::stored(Recent& recent, const Int3& owner, int slot) {
    const ArrayInfo& array = *recent.array;
    const int component = slot - array.first_slot;
    const std::byte* at = recent.find(owner);
    at = at != nullptr ? at + static_cast<std::size_t>(component) * array.codec.element_size
                       : element(recent, owner, component);
    return array.codec.element_size == sizeof(float)
               ? static_cast<double>(*reinterpret_cast<const float*>(at))
               : static_cast<double>(decode_indicator(*reinterpret_cast<const IndicatorCode*>(at)));
}

double NodeSampler::indicator(const Int3& x, Field field) {
    const NodeInfo node = describe_node(x, layout_->lattice().top());
    if (node.scale == 0) {
        return 0;
    }
    const int level = node.level();
    const Int3 p{x.x / node.scale, x.y / node.scale, x.z / node.scale};
    const Int3 owner{p.x / 2, p.y / 2, p.z / 2};
    const int slot = slot_of(p);
    Recent& recent = indicators_[static_cast<std::size_t>(level)];
    look_at(recent, level, field);
    if (slot < recent.array->first_slot) {
        // Level 1: computed from the values of a cube that contains the node.
        const Int3 cube = min(owner, layout_->lattice().elements_at(1) - Int3{1, 1, 1});
        const unsigned mirror = mirror_of(cube);
        CubeValues u{};
        int position = 0;
        for (int i = 0; i < 27; ++i) {
            const Int3 at = cube * 2 + node_offset(i, mirror);
            u[static_cast<std::size_t>(i)] = value(at, 0);
            position = at == x ? i : position;
        }
        return finest_indicator(u, position, saturation_of(field) == Saturation::plus,
                                layout_->rounds_outward());
    }
    return stored(recent, owner, slot);
}

double NodeSampler::grid_indicator(const Int3& x, Field field) {
    const int shift = std::countr_zero(static_cast<std::uint64_t>(x.x | x.y | x.z));
    const int level = shift + 1;
    const Int3 p{x.x >> shift, x.y >> shift, x.z >> shift};
    Recent& recent = indicators_[static_cast<std::size_t>(level)];
    look_at(recent, level, field);
    const int slot = slot_of(p);
    if (slot < recent.array->first_slot) {
        return at_level_1(x, saturation_of(field) == Saturation::plus);
    }
    return stored(recent, {p.x >> 1, p.y >> 1, p.z >> 1}, slot);
}

namespace {

bool is_in(const Box<double>& box, const Int3& p) {
    return max(p, box.lo) == p && max(p + Int3{1, 1, 1}, box.lo + box.size) == box.lo + box.size;
}

/// Level 1: the cubes' centres are stored; faces and edges are computed from the values.
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
            // finest_indicator() needs the all-even corner first: mirror the odd cubes.
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

/// Fills the nodes of one level with all slots stored. The box has coordinates of the lattice of
/// stride 2^shift.
void fill_level(ChunkCache& cache, const ArrayInfo& array, Box<double>& box, int shift) {
    const std::int64_t scale = std::int64_t{1} << (array.level - 1 - shift);
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
        fill_level(cache, layout.array(l, field), box, 0);
    }
}

void fill_indicators_at(ChunkCache& cache, Field field, int level, Box<double>& box) {
    if (level == 0) {
        return fill_indicators(cache, field, 1, box);
    }
    const StoreLayout& layout = cache.source().layout();
    for (int l = level + 1; l <= layout.lattice().top(); ++l) {
        fill_level(cache, layout.array(l, field), box, level);
    }
}

void require_field_of_nodes(const StoreReader& store, Field field) {
    const StoreLayout& layout = store.layout();
    if (field == Field::values || is_of_cells(field)) {
        std::vector<Field> others = layout.header().fields;
        others.erase(std::remove_if(others.begin(), others.end(), is_of_cells), others.end());
        throw Error(
            ErrorKind::invalid_argument, {store.path().string()},
            fmt::format("{} is not an indicator of nodes", name_of(field)),
            {{RemedyKind::other_field, fmt::format("{}", fmt::join(names_of(others), ","))}});
    }
    if (!layout.has(field)) {
        static_cast<void>(layout.array(1, field));  // throws, naming the fields
    }
}

}  // namespace isonest::detail
