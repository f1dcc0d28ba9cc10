#include "preprocess/ranks/partial_levels.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <utility>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "preprocess/indicators/value_rows.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_blocks.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/ranks/pencils.h"
#include "store/base/box.h"
#include "store/container/codec.h"

namespace isonest::detail {

PartialArray::PartialArray(const ArrayInfo& array, const ScratchFolder& folder)
    : array_(&array), file_(folder) {
    file_.map_hole(static_cast<std::uint64_t>(array.nodes.y * array.nodes.z) * row_bytes());
}

std::uint64_t PartialArray::row_bytes() const {
    return static_cast<std::uint64_t>(array_->nodes.x * array_->components) *
           array_->codec.element_size;
}

std::byte* PartialArray::at(const Int3& node) const {
    return bytes().data() +
           static_cast<std::size_t>(array_->nodes.linear(node) * array_->components) *
               array_->codec.element_size;
}

void PartialArray::reserve(const Pencil& pencil, std::int64_t nodes) const {
    const Int3& all = array_->nodes;
    const std::int64_t y = pencil.y * nodes;
    const std::int64_t rows = std::min(nodes, all.y - y);
    for (std::int64_t z = pencil.z * nodes; z < std::min(all.z, (pencil.z + 1) * nodes); ++z) {
        if (rows > 0) {
            file_.fill_hole(static_cast<std::uint64_t>(z * all.y + y) * row_bytes(),
                            static_cast<std::uint64_t>(rows) * row_bytes());
        }
    }
}

void PartialArray::put(const EncodedChunk& chunk) const {
    thread_local std::vector<std::byte> raw;
    const std::size_t element = array_->codec.element_size;
    raw.resize(array_->chunk_bytes());
    decode_chunk(chunk.bytes, array_->codec_of(chunk.row), raw, {"", array_->place(chunk.chunk)});
    const Int3 lo = array_->first_node(chunk.chunk);
    const Int3 n = min(array_->chunk, array_->nodes - lo);
    for (std::int64_t z = 0; z < n.z; ++z) {
        for (std::int64_t y = 0; y < n.y; ++y) {
            std::memcpy(
                at(lo + Int3{0, y, z}),
                raw.data() + static_cast<std::size_t>(array_->chunk.linear({0, y, z})) * element,
                static_cast<std::size_t>(n.x) * element);
        }
    }
    raw = {};
}

ChunkNodes PartialArray::chunk(const Int3& chunk) const {
    const Int3& n = array_->nodes;
    const std::byte* const first = at(array_->first_node(chunk));
    return {DecodedChunk(std::shared_ptr<void>(), first), {1, n.x, n.x * n.y}};
}

bool carries_deviation(const StoreLayout& layout) {
    return layout.has(Field::deviation_bar) || layout.has(Field::deviation_plus);
}

void PartialLevels::begin_pass(int pass, std::span<const Pencil> pencils, std::int64_t cells,
                               bool is_in_parts) {
    const int level = pass - 1;
    const int top = layout_->lattice().top();
    values_.resize(std::max(values_.size(), static_cast<std::size_t>(level) + 1));
    const auto make = [&](const ArrayInfo& array, std::int64_t rows) {
        auto made = std::make_unique<PartialArray>(array, folder_);
        for (const Pencil& pencil : pencils) {
            made->reserve(pencil, rows);
        }
        return made;
    };
    if (level < top) {
        values_[static_cast<std::size_t>(level)] =
            make(layout_->array(level, Field::values), 2 * cells);
    }
    if (pass == kBasePass && top > kBasePass && carries_deviation(*layout_)) {
        deviations_ = make(layout_->array(1, deviation_carried(*layout_)), 2 * cells);
    }
    for (const ArrayInfo& array : layout_->arrays()) {
        if (is_in_parts && array.level == pass && array.field != Field::values && !array.alias) {
            indicators_.push_back(make(array, cells));
        }
    }
}

void PartialLevels::end_pass(int pass) {
    const auto level = static_cast<std::size_t>(pass - 2);
    if (level < values_.size()) {
        values_[level].reset();
    }
    if (pass > kBasePass) {
        deviations_.reset();
    }
    indicators_.clear();
}

const PartialArray* PartialLevels::values(int level) const {
    const auto l = static_cast<std::size_t>(level);
    return l < values_.size() ? values_[l].get() : nullptr;
}

const PartialArray* PartialLevels::indicators(const ArrayInfo& array) const {
    const auto found = std::find_if(indicators_.begin(), indicators_.end(),
                                    [&](const auto& made) { return &made->array() == &array; });
    return found != indicators_.end() ? found->get() : nullptr;
}

/// An alias has the same rows as its array.
const PartialArray* PartialLevels::find(const ArrayInfo& array) const {
    const PartialArray* const found =
        array.field == Field::values ? values(array.level) : deviations_.get();
    return found != nullptr && found->array().first_row == array.first_row ? found : nullptr;
}

void PartialLevels::put(const EncodedChunk& chunk) const {
    if (const PartialArray* const to = find(*chunk.array); to != nullptr) {
        to->put(chunk);
    }
}

ChunkNodes PartialLevels::chunk(const ArrayInfo& array, const Int3& chunk) {
    const PartialArray* const from = find(array);
    if (from == nullptr) {
        throw std::logic_error("no rank keeps this level");
    }
    return from->chunk(chunk);
}

namespace {

/// Stores every second value.
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
    out.encode(std::as_bytes(std::span(raw.get(), size)));
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
