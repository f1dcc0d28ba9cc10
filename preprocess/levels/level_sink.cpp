#include "preprocess/levels/level_sink.h"

#include <algorithm>
#include <utility>

#include "preprocess/indicators/row_kernels.h"
#include "preprocess/levels/pass_context.h"
#include "store/container/codec.h"

namespace isonest::detail {

IndicatorChunks::IndicatorChunks(const ArrayInfo& array, const Int3& first, const Int3& count,
                                 bool exact)
    : array_(array), exact_(exact) {
    const Int3 end = min(first + count, array.grid);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y; ++y) {
            for (std::int64_t x = first.x; x < end.x; ++x) {
                Part part;
                part.chunk = {x, y, z};
                part.lo = array.first_node(part.chunk);
                part.n = min(array.chunk, array.nodes - part.lo);
                part.size = array.chunk;
                part.raw = std::make_unique_for_overwrite<std::byte[]>(array.chunk_bytes());
                if (part.n != array.chunk) {
                    std::fill_n(part.raw.get(), array.chunk_bytes(), std::byte{0});
                }
                parts_.push_back(std::move(part));
            }
        }
    }
}

IndicatorChunks IndicatorChunks::of_nodes(const ArrayInfo& array, const Int3& lo, const Int3& count,
                                          bool exact) {
    IndicatorChunks made(array, exact);
    Part part;
    part.lo = lo;
    part.n = max(min(count, array.nodes - lo), {0, 0, 0});
    part.size = part.n;
    part.raw = std::make_unique_for_overwrite<std::byte[]>(
        static_cast<std::size_t>(part.n.product() * array.components) * array.codec.element_size);
    made.parts_.push_back(std::move(part));
    return made;
}

template <class Stored, class Real>
void IndicatorChunks::put_row(const Real* from, Part& part, std::int64_t at,
                              std::vector<Stored>& line) const {
    Stored* const to = reinterpret_cast<Stored*>(part.raw.get()) + at;
    line.resize(static_cast<std::size_t>(part.n.x));
    Stored* const rounded = array_.components == 1 ? to : line.data();
    const auto [low, high] = round_up_row(from, rounded, part.n.x);
    part.min = std::min(part.min, decode_indicator(low));
    part.max = std::max(part.max, decode_indicator(high));
    if (rounded != to) {
        for (std::int64_t i = 0; i < part.n.x; ++i) {
            to[i * array_.components] = rounded[i];
        }
    }
}

template <class Real>
void IndicatorChunks::put(const LayerRange& range, std::int64_t k, const Layer<Real>& layer) {
    const int first = array_.first_slot;
    for (Part& part : parts_) {
        if (k < part.lo.z || k >= part.lo.z + part.n.z) {
            continue;
        }
        for (std::int64_t j = 0; j < part.n.y; ++j) {
            const std::int64_t at = part.size.linear({0, j, k - part.lo.z}) * array_.components;
            for (int slot = first; slot < first + array_.components; ++slot) {
                const Real* const from =
                    layer.row(slot, part.lo.y + j - range.lo.y) + (part.lo.x - range.lo.x);
                if (exact_) {
                    put_row(from, part, at + slot - first, floats_);
                } else {
                    put_row(from, part, at + slot - first, codes_);
                }
            }
        }
    }
}

template void IndicatorChunks::put(const LayerRange&, std::int64_t, const Layer<float>&);
template void IndicatorChunks::put(const LayerRange&, std::int64_t, const Layer<double>&);

void IndicatorChunks::encode(std::vector<EncodedChunk>& out) const {
    for (const Part& part : parts_) {
        EncodedChunk chunk;
        chunk.array = &array_;
        chunk.chunk = part.chunk;
        chunk.row.min = part.min;
        chunk.row.max = part.max;
        chunk.encode({part.raw.get(), array_.chunk_bytes()});
        out.push_back(std::move(chunk));
    }
}

LevelSink::LevelSink(const StoreLayout& layout, int level, const Int3& first, const Int3& count) {
    for (const Field field : layout.header().fields) {
        const ArrayInfo* const array = find_array(layout, level, field);
        if (array == nullptr || array->alias) {
            continue;
        }
        parts_.emplace_back(level == 1 ? source_at_level_1(field) : field,
                            IndicatorChunks(*array, first, count, layout.header().exact));
    }
}

LevelSink LevelSink::of_nodes(const StoreLayout& layout, int level, const Int3& lo,
                              const Int3& count) {
    LevelSink made;
    for (const Field field : layout.header().fields) {
        const ArrayInfo& array = layout.array(level, field);
        if (!array.alias) {
            made.parts_.emplace_back(
                level == 1 ? source_at_level_1(field) : field,
                IndicatorChunks::of_nodes(array, lo, count, layout.header().exact));
        }
    }
    return made;
}

void LevelSink::encode(std::vector<EncodedChunk>& out) const {
    for (const auto& part : parts_) {
        part.second.encode(out);
    }
}

}  // namespace isonest::detail
