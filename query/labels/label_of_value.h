// The label that a value of a segmentation is.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>

#include <isonest/error.h>

#include "store/base/label_bits.h"

namespace isonest::detail {

/// None of a missing value, or of one that is no whole number. `bits`: whether the store's values
/// stand for labels of 64 bits.
template <class T>
std::optional<std::int64_t> label_of(T value, bool bits) {
    if (bits) {
        return static_cast<std::int64_t>(label_of_value(static_cast<double>(value)));
    }
    constexpr double kMost = 9007199254740992.0;  // 2^53
    if constexpr (std::is_integral_v<T>) {
        return static_cast<std::int64_t>(value);
    } else {
        const auto v = static_cast<double>(value);
        if (!(std::fabs(v) <= kMost) || v != std::floor(v)) {
            return std::nullopt;
        }
        return static_cast<std::int64_t>(v);
    }
}

/// Throws Error{unsupported} for a value that is not missing and that label_of() has no label for.
/// `name`: of the store.
inline void require_missing(double value, const std::string& name) {
    if (std::isfinite(value)) {
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format("the value {} is no label: labels are whole numbers up to 2^53", value));
    }
}

}  // namespace isonest::detail
