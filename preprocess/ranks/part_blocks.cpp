#include "preprocess/ranks/part_blocks.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <utility>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/value_rows.h"
#include "preprocess/levels/coarse_block.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/value_chunks.h"
#include "preprocess/ranks/own_chunks.h"
#include "store/base/box.h"
#include "store/container/codec.h"
#include "store/container/indicator_code.h"

namespace isonest::detail {
namespace {

/// Every second value.
template <class T>
void put_values(const Box<T>& from, const PartialArray& to, const Int3& first, const Int3& count) {
    const Int3& nodes = to.array().nodes;
    const Int3 lo = first * 2;
    const Int3 end = min((first + count) * 2, nodes);
    for (std::int64_t z = lo.z; z < end.z; ++z) {
        for (std::int64_t y = lo.y; y < end.y && lo.x < end.x; ++y) {
            take_row(from.row(2 * y, 2 * z) + (2 * lo.x - from.lo.x), 2,
                     reinterpret_cast<T*>(to.at({lo.x, y, z})), end.x - lo.x);
        }
    }
}

template <class T>
EncodedChunk encode_value_rows(const PartialArray& from, const Int3& chunk) {
    const ArrayInfo& array = from.array();
    const Int3 lo = array.first_node(chunk);
    Box<T> box(lo, min(array.chunk, array.nodes - lo));
    for (std::int64_t z = lo.z; z < lo.z + box.size.z; ++z) {
        for (std::int64_t y = lo.y; y < lo.y + box.size.y; ++y) {
            std::copy_n(reinterpret_cast<const T*>(from.at({lo.x, y, z})), box.size.x,
                        box.row(y, z));
        }
    }
    return encode_values(array, chunk, box, 1);
}

/// Stored: IndicatorCode or float.
template <class Stored>
EncodedChunk encode_indicator_rows(const PartialArray& from, const Int3& chunk) {
    const ArrayInfo& array = from.array();
    const Int3 lo = array.first_node(chunk);
    const Int3 n = min(array.chunk, array.nodes - lo);
    const std::size_t size = array.chunk_bytes() / sizeof(Stored);
    const auto raw = std::make_unique_for_overwrite<Stored[]>(size);
    if (n != array.chunk) {
        std::fill_n(raw.get(), size, Stored{0});
    }
    float low = std::numeric_limits<float>::infinity();
    float high = 0;
    for (std::int64_t z = 0; z < n.z; ++z) {
        for (std::int64_t y = 0; y < n.y; ++y) {
            const auto row = std::span(reinterpret_cast<const Stored*>(from.at(lo + Int3{0, y, z})),
                                       static_cast<std::size_t>(n.x * array.components));
            const auto [least, most] = std::minmax_element(row.begin(), row.end());
            low = std::min(low, decode_indicator(*least));
            high = std::max(high, decode_indicator(*most));
            std::copy(row.begin(), row.end(),
                      raw.get() + array.chunk.linear({0, y, z}) * array.components);
        }
    }
    EncodedChunk out;
    out.array = &array;
    out.chunk = chunk;
    out.row.min = low;
    out.row.max = high;
    encode_chunk(std::as_bytes(std::span(raw.get(), size)), array.codec, out.bytes);
    return out;
}

}  // namespace

template <class T>
void compute_part(const PassContext& context, PartialLevels& levels, int pass, const Int3& first,
                  const Int3& count) {
    const StoreLayout& layout = context.layout;
    const ValueBox<T> box = coarse_values<T>(layout, levels, pass, first, count);
    put_values(box.values, *levels.values(pass - 1), first, count);
    LevelSink sink = LevelSink::of_nodes(layout, pass, first, count);
    coarse_indicators(context, levels, pass, first, count, box, sink);
    sink.each_row([&](const ArrayInfo& array, const Int3& at, std::span<const std::byte> row) {
        std::copy(row.begin(), row.end(), levels.indicators(array)->at(at));
    });
}

template <class T>
std::vector<EncodedChunk> assemble_block(const StoreLayout& layout, const PartialLevels& levels,
                                         int pass, const Int3& block) {
    std::vector<EncodedChunk> out;
    for (const ChunkPlace& place : chunks_of(layout, pass, block)) {
        const ArrayInfo& array = *place.array;
        if (array.field == Field::values) {
            out.push_back(encode_value_rows<T>(*levels.values(array.level), place.chunk));
        } else if (layout.header().exact) {
            out.push_back(encode_indicator_rows<float>(*levels.indicators(array), place.chunk));
        } else {
            out.push_back(
                encode_indicator_rows<IndicatorCode>(*levels.indicators(array), place.chunk));
        }
    }
    return out;
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T)                                                                \
    template void compute_part<T>(const PassContext&, PartialLevels&, int, const Int3&,            \
                                  const Int3&);                                                    \
    template std::vector<EncodedChunk> assemble_block<T>(const StoreLayout&, const PartialLevels&, \
                                                         int, const Int3&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

}  // namespace isonest::detail
