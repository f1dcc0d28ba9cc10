// Chunks of values: a level is the finer one at every second node (injection).
#pragma once

#include <algorithm>
#include <memory>
#include <span>
#include <vector>

#include "preprocess/indicators/value_rows.h"
#include "preprocess/levels/indicator_chunks.h"
#include "preprocess/levels/value_range.h"
#include "store/base/box.h"
#include "store/container/codec.h"

namespace isonest::detail {

/// One chunk of values by injection: node i of the array is node step * i of the box.
template <class T>
EncodedChunk encode_values(const ArrayInfo& array, const Int3& chunk, const Box<T>& box,
                           std::int64_t step) {
    const Int3 lo = array.first_node(chunk);
    const Int3 n = min(array.chunk, array.nodes - lo);
    const auto size = static_cast<std::size_t>(array.chunk.product());
    const auto raw = std::make_unique_for_overwrite<T[]>(size);
    if (n != array.chunk) {
        std::fill_n(raw.get(), size, T{0});  // beyond the array's edge
    }
    EncodedChunk out;
    out.array = &array;
    out.chunk = chunk;
    ValueRange<T> range;
    for (std::int64_t z = 0; z < n.z; ++z) {
        for (std::int64_t y = 0; y < n.y; ++y) {
            const T* const from =
                box.row((lo.y + y) * step, (lo.z + z) * step) + (lo.x * step - box.lo.x);
            T* const to = raw.get() + array.chunk.linear({0, y, z});
            take_row(from, step, to, n.x);
            range.include(to, n.x);
        }
    }
    out.row.min = range.min();
    out.row.max = range.max();
    out.row.flags = range.missing() ? kChunkHasMissing : 0;
    encode_chunk(std::as_bytes(std::span(raw.get(), size)), array.codec, out.bytes);
    return out;
}

template <class T>
void encode_all_values(const ArrayInfo* array, const Int3& first, const Int3& count,
                       const Box<T>& box, std::int64_t step, std::vector<EncodedChunk>& out) {
    if (array == nullptr) {
        return;
    }
    const Int3 end = min(first + count, array->grid);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y; ++y) {
            for (std::int64_t x = first.x; x < end.x; ++x) {
                out.push_back(encode_values(*array, {x, y, z}, box, step));
            }
        }
    }
}

}  // namespace isonest::detail
