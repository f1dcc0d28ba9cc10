#include "preprocess/indicator_chunks.h"

#include <cstring>

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
                for (std::int64_t i = 0; i < part.n.x; ++i) {
                    const float up = round_up_to_float(from[i]);
                    const std::int64_t to = at + i * n + slot - first;
                    float stored = up;
                    if (exact_) {
                        reinterpret_cast<float*>(part.raw.data())[to] = up;
                    } else {
                        const IndicatorCode code = encode_indicator(up);
                        reinterpret_cast<IndicatorCode*>(part.raw.data())[to] = code;
                        stored = decode_indicator(code);
                    }
                    part.min = stored < part.min ? stored : part.min;
                    part.max = stored > part.max ? stored : part.max;
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
        encode_chunk(part.raw, array_.codec, chunk.bytes);
        chunk.bytes.shrink_to_fit();
        out.push_back(std::move(chunk));
    }
}

}  // namespace isonest
