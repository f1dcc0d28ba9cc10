#include "preprocess/ranks/partial_levels.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include <isonest/field.h>

#include "preprocess/levels/pass_context.h"
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
    decode_chunk(chunk.bytes, array_->codec, raw, {"", array_->place(chunk.chunk)});
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

/// An alias has the rows of its array.
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
        throw std::logic_error("a level that no rank keeps");
    }
    return from->chunk(chunk);
}

}  // namespace isonest::detail
