// The extents of a store's labels, and the label of a value.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>

#include <isonest/error.h>
#include <isonest/labels.h>
#include <isonest/progress.h>

#include "store/base/label_text.h"
#include "store/container/reader.h"

namespace isonest::detail {

// The label of a value in a segmentation.

/// Nothing for a missing value, or one that is not an integer. `bits`: whether the store's values
/// represent 64-bit labels.
template <class T>
std::optional<std::int64_t> label_of(T value, bool bits) {
    if (bits) {
        return static_cast<std::int64_t>(label_of_value(static_cast<double>(value)));
    }
    constexpr double kMax = 9007199254740992.0;  // 2^53
    if constexpr (std::is_integral_v<T>) {
        return static_cast<std::int64_t>(value);
    } else {
        const auto v = static_cast<double>(value);
        if (!(std::fabs(v) <= kMax) || v != std::floor(v)) {
            return std::nullopt;
        }
        return static_cast<std::int64_t>(v);
    }
}

/// Throws Error{unsupported} for a value that is not missing but for which label_of() returns
/// nothing. `name`: of the store.
inline void require_missing(double value, const std::string& name) {
    if (std::isfinite(value)) {
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format("the value {} is not a label: labels are integers up to 2^53", value));
    }
}

// Progress of the work on one of many labels.

/// Not reported to anyone; only cancellation is passed on.
class LabelProgress : public Progress {
  public:
    explicit LabelProgress(const Progress& whole) : whole_(whole) {}
    [[nodiscard]] bool cancelled() const override { return whole_.cancelled(); }

  private:
    const Progress& whole_;
};

// The extent of one label of a store.

/// The label `id`, with value `value`, and its nodes; nothing if there are none. Reads the chunks
/// that may contain it, one per thread at a time. Throws Error{corrupt, io, cancelled}.
std::optional<Label> find_label(const StoreReader& store, std::int64_t id, double value,
                                int threads, Progress& progress);

}  // namespace isonest::detail
