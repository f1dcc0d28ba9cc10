// A view of a store of labels for a single label: 1 at its nodes, 0 elsewhere.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include <isonest/int3.h>

#include "store/container/wrapped_sources.h"

namespace isonest::detail {

class StoreReader;

/// Only the finest values: coarser levels and indicators are those of the labels and have no
/// meaning here. Missing values are 0. `source` must outlive it. Thread-safety: all methods from
/// any thread.
class LabelView : public ForwardingSource {
  public:
    /// Nodes outside [low, high] are 0 without being read. REQUIRES: is_label().
    LabelView(const ChunkSource& source, std::int64_t label, const Int3& low, const Int3& high);
    /// Range by the chunk's smallest and largest label.
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    /// Nothing: ranges in the store are for its labels.
    [[nodiscard]] std::optional<CubeRange> cube_range(int /*level*/,
                                                      const Int3& /*cube*/) const override {
        return std::nullopt;
    }

  private:
    double value_;  ///< of the label
    Int3 low_;
    Int3 high_;
};

/// Whether the store's value type can represent this label.
bool is_label(const StoreHeader& header, std::int64_t label);
/// REQUIRES: is_label().
double value_of_label(const StoreHeader& header, std::int64_t label);
/// The label represented by a store's value, if its values represent 64-bit labels and this one is
/// finite; otherwise nothing.
std::optional<std::int64_t> wide_label(const StoreHeader& header, double value);
/// The value type as shown to users: "int64" if values represent 64-bit labels.
std::string_view type_of_values(const StoreHeader& header);
/// Throws Error{unsupported} for a store whose values represent 64-bit labels: `what` ("a slice")
/// would calculate with the codes of labels.
void require_numbers(const StoreReader& store, std::string_view what);

}  // namespace isonest::detail
