// Where the layers of one level of a block go: into the chunks of its fields, and their centres on
// to the coarser levels.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/row_kernels.h"
#include "preprocess/levels/indicator_chunks.h"
#include "store/base/box.h"
#include "store/container/format.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The indicator chunks of one level that a block fills.
class LevelSink {
  public:
    /// `first` chunk and how many per axis, of every field that is stored at the level.
    LevelSink(const StoreLayout& layout, int level, const Int3& first, const Int3& count);
    template <class Real>
    void put(Field field, const LayerRange& range, std::int64_t k, const Layer<Real>& layer) {
        for (auto& [source, chunks] : parts_) {
            if (source == field) {
                chunks.put(range, k, layer);
            }
        }
    }
    void encode(std::vector<EncodedChunk>& out) const;
    /// Of lattice nodes, not of chunks: `count` per axis from `lo` on, as far as there are any.
    static LevelSink of_nodes(const StoreLayout& layout, int level, const Int3& lo,
                              const Int3& count);
    /// f(array, lattice node, bytes) for each row along x, as stored.
    template <class F>
    void each_row(const F& f) const {
        for (const auto& part : parts_) {
            const IndicatorChunks& chunks = part.second;
            chunks.each_row([&](const Int3& at, std::span<const std::byte> bytes) {
                f(chunks.array(), at, bytes);
            });
        }
    }

  private:
    LevelSink() = default;
    std::vector<std::pair<Field, IndicatorChunks>> parts_;
};

/// Copies the centres of layer k (in slot `centre`) that lie in `to`.
template <class Real>
void keep_centres(int centre, const LayerRange& range, std::int64_t k, const Layer<Real>& layer,
                  Box<float>& to) {
    const Int3 o = slot_offset(centre);
    const auto count = [&](int axis) { return range.count(axis, static_cast<int>(o[axis])); };
    if (k < to.lo.z || k >= to.lo.z + to.size.z || k - range.lo.z >= count(2)) {
        return;
    }
    const Int3 lo = max(range.lo, to.lo);
    const Int3 end = min(range.lo + Int3{count(0), count(1), 0}, to.lo + to.size);
    for (std::int64_t y = lo.y; y < end.y; ++y) {
        const Real* const from = layer.row(centre, y - range.lo.y);
        round_up_row(from + (lo.x - range.lo.x), to.row(y, k) + (lo.x - to.lo.x),
                     std::max<std::int64_t>(end.x - lo.x, 0));
    }
}

}  // namespace isonest::detail
