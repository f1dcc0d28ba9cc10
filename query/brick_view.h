// What the traversal sees of one brick: values and indicators straight from the decoded chunks.
#pragma once

#include <array>
#include <cmath>

#include "store/chunk_cache.h"
#include "store/indicator_code.h"

namespace isonest {

/// The up to 2 x 2 x 2 neighbouring chunks of one array that hold the nodes from `base` on; each is
/// decoded when first touched. Not thread-safe.
class ChunkGroup {
  public:
    ChunkGroup() = default;
    /// REQUIRES: base is a multiple of the array's chunk.
    ChunkGroup(ChunkCache& cache, const ArrayInfo& array, const Int3& base)
        : cache_(&cache), array_(&array), first_(array.chunk_of(base)) {}

    /// The element of node base + p. REQUIRES: 0 <= p < 2 chunk, inside the lattice.
    template <class T>
    [[nodiscard]] T at(const Int3& p, int component = 0) {
        const Int3& c = array_->chunk;
        const Int3 which{p.x >= c.x ? 1 : 0, p.y >= c.y ? 1 : 0, p.z >= c.z ? 1 : 0};
        const auto slot = static_cast<std::size_t>(which.x + 2 * which.y + 4 * which.z);
        if (chunks_[slot] == nullptr) {
            chunks_[slot] = cache_->get(*array_, first_ + which);
        }
        const Int3 local{p.x - which.x * c.x, p.y - which.y * c.y, p.z - which.z * c.z};
        return reinterpret_cast<const T*>(
            chunks_[slot].get())[c.linear(local) * array_->components + component];
    }

    /// The element of node base + p if the chunk at the base, decoded, holds nodes p to p + size;
    /// else null. Its neighbours follow by Int3::linear of the array's chunk.
    template <class T>
    [[nodiscard]] const T* within_first(const Int3& p, std::int64_t size) const {
        const Int3& c = array_->chunk;
        const bool inside = p.x + size < c.x && p.y + size < c.y && p.z + size < c.z;
        return inside && chunks_[0] != nullptr
                   ? reinterpret_cast<const T*>(chunks_[0].get()) + c.linear(p)
                   : nullptr;
    }

  private:
    ChunkCache* cache_ = nullptr;
    const ArrayInfo* array_ = nullptr;
    Int3 first_;
    std::array<DecodedChunk, 8> chunks_;
};

/// An indicator field around one brick.
class IndicatorView {
  public:
    IndicatorView() = default;
    IndicatorView(ChunkCache& cache, const ArrayInfo& array, const Int3& base)
        : chunks_(cache, array, base),
          first_slot_(array.first_slot),
          exact_(array.codec.element_size == sizeof(float)) {}
    /// REQUIRES: the array stores the slot: slot >= ArrayInfo::first_slot.
    [[nodiscard]] double at(const Int3& node, int slot) {
        const int component = slot - first_slot_;
        return exact_ ? static_cast<double>(chunks_.at<float>(node, component))
                      : static_cast<double>(
                            decode_indicator(chunks_.at<IndicatorCode>(node, component)));
    }

  private:
    ChunkGroup chunks_;
    int first_slot_ = 0;
    bool exact_ = false;
};

}  // namespace isonest
