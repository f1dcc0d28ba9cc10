// A store of labels seen as one of a single label: 1 at its nodes, 0 elsewhere.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include <isonest/int3.h>

#include "store/container/wrapping/forwarding_source.h"

namespace isonest::detail {

/// The finest values alone: coarser levels and indicators are those of the labels, and mean nothing
/// here. Missing values are 0. `source` must outlive it. Thread-safety: all methods from any
/// thread.
class LabelView : public ForwardingSource {
  public:
    /// Nodes outside of [low, high] are 0 without a look at them.
    /// REQUIRES: is_label().
    LabelView(const ChunkSource& source, std::int64_t label, const Int3& low, const Int3& high);
    /// As the chunk's smallest and largest label allow.
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    /// Nothing: those of the store are of its labels.
    [[nodiscard]] std::optional<CubeRange> cube_range(int /*level*/,
                                                      const Int3& /*cube*/) const override {
        return std::nullopt;
    }

  private:
    double value_;  ///< of the label
    Int3 low_;
    Int3 high_;
};

/// Whether the store's type of values has one for this label.
bool is_label(const StoreHeader& header, std::int64_t label);
/// REQUIRES: is_label().
double value_of_label(const StoreHeader& header, std::int64_t label);

}  // namespace isonest::detail
