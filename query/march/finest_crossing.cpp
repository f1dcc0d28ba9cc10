#include "query/march/finest_crossing.h"

#include <bit>
#include <cmath>

namespace isonest::detail {
namespace {

/// The coarsest level that has the node, up to any store's top.
int level_of(const Int3& node) {
    const auto bits = static_cast<std::uint64_t>(node.x | node.y | node.z);
    return bits == 0 ? 0 : std::countr_zero(bits);
}

}  // namespace

FinestCrossing::Edge FinestCrossing::between(const Int3& a, double a_value, const Int3& b,
                                             double b_value) {
    const bool in_order = a.z != b.z ? a.z < b.z : a.y != b.y ? a.y < b.y : a.x < b.x;
    return in_order ? Edge{a, b, a_value, b_value} : Edge{b, a, b_value, a_value};
}

FinestCrossing::Edge FinestCrossing::finest(Edge edge) {
    for (;;) {
        const Int3 twice = edge.from + edge.to;
        if (((twice.x | twice.y | twice.z) & 1) != 0) {
            return edge;
        }
        const Int3 middle{twice.x / 2, twice.y / 2, twice.z / 2};
        const double value = nodes_.value(middle, level_of(middle));
        if (!std::isfinite(value)) {
            return edge;
        }
        if ((edge.from_value < iso_) != (value < iso_)) {
            edge.to = middle;
            edge.to_value = value;
        } else {
            edge.from = middle;
            edge.from_value = value;
        }
    }
}

}  // namespace isonest::detail
