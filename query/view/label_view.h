// A store of labels seen as one of a single label: 1 at its nodes, 0 elsewhere.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include <isonest/int3.h>

#include "store/container/wrapping/forwarding_source.h"

namespace isonest::detail {

class StoreReader;

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
/// The label that a store's value stands for, if its values stand for labels of 64 bits and this
/// one is finite; else nothing.
std::optional<std::int64_t> wide_label(const StoreHeader& header, double value);
/// The type of a store's values to whoever reads them: "int64" where they stand for labels of 64
/// bits.
std::string_view type_of_values(const StoreHeader& header);
/// Throws Error{unsupported} for a store whose values stand for labels of 64 bits: `what` ("a
/// slice") would calculate with the codes of labels.
void require_numbers(const StoreReader& store, std::string_view what);

}  // namespace isonest::detail
