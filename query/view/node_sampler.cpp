#include "query/view/node_sampler.h"

#include <algorithm>

#include "query/view/finest_indicators.h"

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

void NodeSampler::look_at(Recent& recent, int level, Field field) {
    if (recent.array == nullptr || recent.array->field != field) {
        recent = {&layout_->array(level, field), {-1, -1, -1}, {}, {}};
    }
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
        from.part = {};
        const bool whole = home || !home_level_;
        from = {&array, chunk, array.first_node(chunk),
                whole ? ChunkPart{cache_->get(array, chunk), true} : cache_->part(array, chunk, p)};
        at = cache_->find(array, from.part, p);
    }
    return at + static_cast<std::size_t>(component) * array.codec.element_size;
}

double NodeSampler::value(const Int3& p, int level) {
    const int from = std::min(level, layout_->lattice().top());
    Recent& recent = values_[static_cast<std::size_t>(from)];
    look_at(recent, from, Field::values);
    const Int3 node = max({0, 0, 0}, min({p.x >> from, p.y >> from, p.z >> from},
                                         recent.array->nodes - Int3{1, 1, 1}));
    const std::byte* const at = element(recent, node, 0);
    return dispatch(layout_->header().type, [&](auto tag) {
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
        g[a] = (value(high, level) - value(low, level)) /
               (static_cast<double>(high[axis] - low[axis]) * layout_->header().spacing[a]);
    }
    return g;
}

double NodeSampler::at_level_1(const Int3& x, const NodeInfo& node, bool plus) {
    const double eta = finest_offset(value(x, 0), value(node.end0, 0), value(node.end1, 0),
                                     layout_->rounds_outward());
    if (node.kind == NodeKind::edge) {
        return eta;
    }
    const int top = layout_->lattice().top();
    double largest = 0;
    for (int axis = 0; axis < 3; ++axis) {
        if (node.odd[static_cast<std::size_t>(axis)]) {
            for (const std::int64_t step : {-1, 1}) {
                Int3 child = x;
                child[axis] += step;
                largest = std::max(largest, at_level_1(child, describe_node(child, top), plus));
            }
        }
    }
    return plus ? eta + largest : std::max(eta, largest);
}

double NodeSampler::stored(Recent& recent, const Int3& owner, int slot) {
    const ArrayInfo& array = *recent.array;
    const std::byte* const at = element(recent, owner, slot - array.first_slot);
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
        // Level 1: from the values of a cube that holds the node.
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
    const NodeInfo node = describe_node(x, layout_->lattice().top());
    const int level = node.level();
    const int shift = level - 1;
    const Int3 p{x.x >> shift, x.y >> shift, x.z >> shift};
    Recent& recent = indicators_[static_cast<std::size_t>(level)];
    look_at(recent, level, field);
    const int slot = slot_of(p);
    if (slot < recent.array->first_slot) {
        return at_level_1(x, node, saturation_of(field) == Saturation::plus);
    }
    return stored(recent, {p.x >> 1, p.y >> 1, p.z >> 1}, slot);
}

}  // namespace isonest::detail
