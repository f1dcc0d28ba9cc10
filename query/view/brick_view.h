// What the traversal sees of one brick: values and indicators straight from the decoded chunks.
#pragma once

#include <array>
#include <cmath>

#include "store/container/chunk_cache.h"
#include "store/container/indicator_code.h"

namespace isonest::detail {

/// The nodes of one chunk, from `base` on, and the first ones of the chunks after it along each
/// axis: up to 2 x 2 x 2, each decoded when first touched. Not thread-safe, const members neither.
class ChunkGroup {
  public:
    ChunkGroup() = default;
    /// REQUIRES: base is a multiple of the array's chunk.
    ChunkGroup(ChunkCache& cache, const ArrayInfo& array, const Int3& base)
        : cache_(&cache), array_(&array), first_(array.chunk_of(base)) {}

    /// The element of node base + p. REQUIRES: 0 <= p <= chunk, inside the lattice.
    template <class T>
    [[nodiscard]] T at(const Int3& p, int component = 0) const {
        const Int3& c = array_->chunk;
        if (p.x < c.x && p.y < c.y && p.z < c.z) {
            if (first_chunk_ == nullptr) {
                first_chunk_ = cache_->get(*array_, first_);
            }
            return reinterpret_cast<const T*>(
                first_chunk_.get())[c.linear(p) * array_->components + component];
        }
        const Int3 which{p.x >= c.x ? 1 : 0, p.y >= c.y ? 1 : 0, p.z >= c.z ? 1 : 0};
        const auto slot = static_cast<unsigned>(which.x + 2 * which.y + 4 * which.z);
        ChunkNodes& nodes = next_[slot - 1];
        if (nodes.data == nullptr) {
            nodes = cache_->nodes(*array_, first_ + which, slot);
        }
        const std::int64_t element = (p.x - which.x * c.x) * nodes.stride.x +
                                     (p.y - which.y * c.y) * nodes.stride.y +
                                     (p.z - which.z * c.z) * nodes.stride.z;
        return reinterpret_cast<const T*>(
            nodes.data.get())[element * array_->components + component];
    }

    /// The element of node base + p if the chunk at the base, decoded, holds nodes p to p + size;
    /// else null. Its neighbours follow by Int3::linear of the array's chunk.
    template <class T>
    [[nodiscard]] const T* within_first(const Int3& p, std::int64_t size) const {
        const Int3& c = array_->chunk;
        const bool inside = p.x + size < c.x && p.y + size < c.y && p.z + size < c.z;
        return inside && first_chunk_ != nullptr
                   ? reinterpret_cast<const T*>(first_chunk_.get()) + c.linear(p)
                   : nullptr;
    }

  private:
    ChunkCache* cache_ = nullptr;
    const ArrayInfo* array_ = nullptr;
    Int3 first_;
    mutable DecodedChunk first_chunk_;
    mutable std::array<ChunkNodes, 7> next_;
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
    [[nodiscard]] double at(const Int3& node, int slot) const {
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

}  // namespace isonest::detail
