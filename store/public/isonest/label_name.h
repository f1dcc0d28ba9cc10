// What labels of a segmentation are called, and in which colour they are drawn.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace isonest {

/// Red, green and blue, as screens have them (sRGB).
using LabelColor = std::array<std::uint8_t, 3>;

/// What is said of one label: a name, a colour, or both.
struct LabelName {
    std::int64_t id = 0;
    /// UTF-8 without control characters, at most kMostBytes; empty: it has none.
    std::string name = {};
    std::optional<LabelColor> color = {};

    static constexpr std::size_t kMostBytes = 255;
    /// A store holds so many at most.
    static constexpr std::size_t kMostOfStore = std::size_t{1} << 16U;

    bool operator==(const LabelName&) const = default;
};

}  // namespace isonest
