#include "query/slabs/value_range.h"

#include <algorithm>

#include "query/slabs/node_bits.h"
#include "query/slabs/slab_values.h"

namespace isonest::detail {

void ValueRange::add(const ValueRange& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
}

ValueRange range_of(ValueType type, const SlabPlanes& planes, const Int3& nodes, std::int64_t begin,
                    std::int64_t end) {
    return dispatch(type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        const SlabValues<T> values{reinterpret_cast<const T*>(planes.data), planes.first, nodes};
        ValueRange range;
        for (std::int64_t z = begin; z < end; ++z) {
            widen_range(values.at({0, 0, z}), nodes.x * nodes.y, range.low, range.high);
        }
        return range;
    });
}

}  // namespace isonest::detail
