#include "preprocess/indicator_chunks.h"

#include <algorithm>
#include <bit>

#include "preprocess/row_kernels.h"
#include "store/codec.h"

namespace isonest {

IndicatorChunks::IndicatorChunks(const ArrayInfo& array, const Int3& first, const Int3& count,
                                 bool exact)
    : array_(array), exact_(exact) {
    const Int3 end = min(first + count, array.grid);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y; ++y) {
            for (std::int64_t x = first.x; x < end.x; ++x) {
                Part part;
                part.chunk = {x, y, z};
                part.lo = {x * array.chunk.x, y * array.chunk.y, z * array.chunk.z};
                part.n = min(array.chunk, array.nodes - part.lo);
                part.raw.resize(array.chunk_bytes());
                parts_.push_back(std::move(part));
            }
        }
    }
}

template <class Real>
void IndicatorChunks::put(const LayerRange& range, std::int64_t k, const Layer<Real>& layer) {
    for (Part& part : parts_) {
        if (k < part.lo.z || k >= part.lo.z + part.n.z) {
            continue;
        }
        for (std::int64_t j = 0; j < part.n.y; ++j) {
            const int first = array_.first_slot();
            const int n = array_.components;
            const std::int64_t at = array_.chunk.linear({0, j, k - part.lo.z}) * n;
            for (int slot = first; slot < kSlots; ++slot) {
                const Real* const from =
                    layer.row(slot, part.lo.y + j - range.lo.y) + (part.lo.x - range.lo.x);
                // Bits of non-negative floats are in the order of their values.
                line_.resize(static_cast<std::size_t>(part.n.x));
                round_up_row(from, line_.data(), part.n.x, exact_ ? 0U : 0xFFFFU);
                for (const std::uint32_t bits : line_) {
                    part.min = std::min(part.min, bits);
                    part.max = std::max(part.max, bits);
                }
                const std::int64_t to = at + slot - first;
                if (exact_) {
                    auto* const out = reinterpret_cast<std::uint32_t*>(part.raw.data()) + to;
                    for (std::int64_t i = 0; i < part.n.x; ++i) {
                        out[i * n] = line_[static_cast<std::size_t>(i)];
                    }
                } else {
                    auto* const out = reinterpret_cast<IndicatorCode*>(part.raw.data()) + to;
                    for (std::int64_t i = 0; i < part.n.x; ++i) {
                        out[i * n] =
                            static_cast<IndicatorCode>(line_[static_cast<std::size_t>(i)] >> 16);
                    }
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
        chunk.row.min = static_cast<double>(std::bit_cast<float>(part.min));
        chunk.row.max = static_cast<double>(std::bit_cast<float>(part.max));
        encode_chunk(part.raw, array_.codec, chunk.bytes);
        chunk.bytes.shrink_to_fit();
        out.push_back(std::move(chunk));
    }
}

}  // namespace isonest
