#include "query/traverse/remote/look_ahead.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

/// A node of the finest lattice, in the lattice of a level.
Int3 on_level(const Int3& p, int level) {
    return {p.x >> level, p.y >> level, p.z >> level};
}

}  // namespace

EdgeNeeds::EdgeNeeds(const TraversalRun& run)
    : query_(run.query), layout_(run.layout()), values_(run.cache) {}

void EdgeNeeds::edge(const Int3& a, double a_value, const Int3& b, double b_value, Wants& wants) {
    if ((a_value < query_.iso) == (b_value < query_.iso)) {
        return;
    }
    if (query_.vertices == VertexPlace::exact) {
        crossing(a, a_value, b, b_value, wants);
    }
    attributes(a, b, wants);
    if (a_value == query_.iso) {
        node(a, wants);
    }
    if (b_value == query_.iso) {
        node(b, wants);
    }
}

void EdgeNeeds::node(const Int3& p, Wants& wants) {
    attributes(p, p, wants);
}

/// Corresponds to the reads of AttributeSampler::sample().
void EdgeNeeds::attributes(const Int3& a, const Int3& b, Wants& wants) {
    const AttributeChoice& choice = query_.attributes;
    if (choice.width() == 0) {
        return;
    }
    const Int3 d = b - a;
    const auto reach = static_cast<std::uint64_t>(
        std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z), std::int64_t{1}}));
    const int level = std::min(std::countr_zero(reach), layout_.lattice().top());
    const ArrayInfo& values = layout_.array(level, Field::values);
    for (const Int3& end : {a, b}) {
        const Int3 at = on_level(end, level);
        if (choice.value && query_.attribute_values != nullptr) {
            const ArrayInfo& other =
                query_.attribute_values->source().layout().array(level, Field::values);
            wants.other_chunk(other, other.chunk_of(min(at, other.nodes - Int3{1, 1, 1})));
        }
        wants.box(values, at, at);
        for (int axis = 0; axis < 3 && choice.needs_gradient(); ++axis) {
            Int3 step{};
            step[axis] = 1;
            wants.box(values, at - step, at - step);
            wants.box(values, at + step, at + step);
        }
    }
    const Int3 sum = a + b;
    if (choice.error && !(a == b) && ((sum.x | sum.y | sum.z) & 1) == 0) {
        const Int3 middle{sum.x / 2, sum.y / 2, sum.z / 2};
        const NodeInfo node = describe_node(middle, layout_.lattice().top());
        if (node.scale == 0) {
            return;
        }
        const Int3 p{middle.x / node.scale, middle.y / node.scale, middle.z / node.scale};
        const Int3 owner{p.x / 2, p.y / 2, p.z / 2};
        const ArrayInfo& array = layout_.array(node.level(), *choice.error);
        if (slot_of(p) >= array.first_slot) {
            wants.box(array, owner, owner);
        } else {
            const Int3 cube = min(owner, layout_.lattice().elements_at(1) - Int3{1, 1, 1});
            wants.box(layout_.array(0, Field::values), cube * 2, cube * 2 + Int3{2, 2, 2});
        }
    }
}

/// Corresponds to the reads of FinestCrossing::finest().
void EdgeNeeds::crossing(const Int3& a, double a_value, const Int3& b, double b_value,
                         Wants& wants) {
    FinestCrossing::Edge edge = FinestCrossing::between(a, a_value, b, b_value);
    for (;;) {
        const Int3 twice = edge.from + edge.to;
        if (((twice.x | twice.y | twice.z) & 1) != 0) {
            return;
        }
        const Int3 middle{twice.x / 2, twice.y / 2, twice.z / 2};
        const int level = std::min(level_of_node(middle), layout_.lattice().top());
        const Int3 at = on_level(middle, level);
        if (!wants.box(layout_.array(level, Field::values), at, at)) {
            return finer(edge, level, wants);
        }
        const double value = values_.value(middle, level);
        if (!std::isfinite(value)) {
            return;
        }
        if ((edge.from_value < query_.iso) != (value < query_.iso)) {
            edge.to = middle;
            edge.to_value = value;
        } else {
            edge.from = middle;
            edge.from_value = value;
        }
    }
}

/// Adds what is read below the level for any position of the crossing on the edge, if that is one
/// or two chunks: so an edge needs few round trips.
void EdgeNeeds::finer(const FinestCrossing::Edge& edge, int level, Wants& wants) const {
    constexpr std::int64_t kFew = 2;
    const Int3 low = min(edge.from, edge.to);
    const Int3 high = max(edge.from, edge.to);
    for (int l = level - 1; l >= 0; --l) {
        const ArrayInfo& array = layout_.array(l, Field::values);
        const Int3 last = array.nodes - Int3{1, 1, 1};
        const Int3 chunks = array.chunk_of(min(on_level(high, l), last)) -
                            array.chunk_of(min(on_level(low, l), last)) + Int3{1, 1, 1};
        if (chunks.product() > kFew) {
            return;
        }
        wants.box(array, on_level(low, l), on_level(high, l));
    }
}

}  // namespace isonest::detail
