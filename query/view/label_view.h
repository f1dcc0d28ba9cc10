// A store of labels seen as one of a single label: 1 at its nodes, 0 elsewhere.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/int3.h>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// The finest values alone: coarser levels and indicators are those of the labels, and mean nothing
/// here. Missing values are 0. `source` must outlive it. Thread-safety: all methods from any
/// thread.
class LabelView : public ChunkSource {
  public:
    /// Nodes outside of [low, high] are 0 without a look at them.
    /// REQUIRES: is_label().
    LabelView(const ChunkSource& source, std::int64_t label, const Int3& low, const Int3& high);
    [[nodiscard]] const StoreLayout& layout() const override { return source_.layout(); }
    /// As the chunk's smallest and largest label allow.
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    void prefetch(const ArrayInfo& array, const Int3& chunk) const override {
        source_.prefetch(array, chunk);
    }
    void prefetch_rows(const ArrayInfo& array, const Int3& begin, const Int3& end) const override {
        source_.prefetch_rows(array, begin, end);
    }
    [[nodiscard]] bool is_far() const override { return source_.is_far(); }
    void prefetch_all(std::span<const WantedChunk> chunks) const override {
        source_.prefetch_all(chunks);
    }

  private:
    const ChunkSource& source_;
    double value_;  ///< of the label
    Int3 low_;
    Int3 high_;
};

/// Whether the store's type of values has one for this label.
bool is_label(const StoreHeader& header, std::int64_t label);
/// REQUIRES: is_label().
double value_of_label(const StoreHeader& header, std::int64_t label);

}  // namespace isonest::detail
