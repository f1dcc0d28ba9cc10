// Names and colours of the labels of a segmentation.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace isonest {

/// Red, green and blue in sRGB.
using LabelColor = std::array<std::uint8_t, 3>;

/// The name of a label, its colour, or both.
struct LabelName {
    std::int64_t id = 0;
    /// UTF-8 without control characters, at most kMaxBytes bytes; empty: no name.
    std::string name = {};
    std::optional<LabelColor> color = {};

    static constexpr std::size_t kMaxBytes = 255;
    /// Maximum number of label names in a store.
    static constexpr std::size_t kMaxOfStore = std::size_t{1} << 16U;
    [[deprecated("now called kMaxBytes")]] static constexpr std::size_t kMostBytes = kMaxBytes;
    [[deprecated("now called kMaxOfStore")]] static constexpr std::size_t kMostOfStore =
        kMaxOfStore;

    bool operator==(const LabelName&) const = default;
};

}  // namespace isonest
