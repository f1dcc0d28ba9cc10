// The range of the finite values in planes of a volume.
#pragma once

#include <cstdint>
#include <limits>

#include <isonest/int3.h>
#include <isonest/value_type.h>

#include "query/slabs/slab_reader.h"

namespace isonest::detail {

/// low > high: there is none.
struct ValueRange {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();

    void add(const ValueRange& other);
};

/// Of planes [begin, end) of a volume of so many nodes. REQUIRES: they are there.
ValueRange range_of(ValueType type, const SlabPlanes& planes, const Int3& nodes, std::int64_t begin,
                    std::int64_t end);

}  // namespace isonest::detail
