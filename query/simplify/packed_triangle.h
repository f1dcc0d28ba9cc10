// A triangle of a mesh in as few bytes as go, while a mesh waits in a temporary file.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "query/mesh/corner_file.h"
#include "query/simplify/mapping/displacement.h"

namespace isonest::detail {

/// REQUIRES: vertices are below 2^48.
struct PackedTriangle {
    std::array<std::uint32_t, 3> low{};   ///< bits of the corners
    std::array<std::uint16_t, 3> high{};  ///< and those above
    std::uint16_t mark = 0;
    Displacement displacement;

    PackedTriangle() = default;
    PackedTriangle(const ElementCorners& corners, std::uint16_t of, const Displacement& by)
        : mark(of), displacement(by) {
        for (std::size_t i = 0; i < corners.size(); ++i) {
            low[i] = static_cast<std::uint32_t>(corners[i]);
            high[i] = static_cast<std::uint16_t>(corners[i] >> kLow);
        }
    }
    [[nodiscard]] ElementCorners corners() const {
        ElementCorners c{};
        for (std::size_t i = 0; i < c.size(); ++i) {
            c[i] = std::uint64_t{high[i]} << kLow | low[i];
        }
        return c;
    }

  private:
    static constexpr unsigned kLow = 32;
};
static_assert(sizeof(PackedTriangle) == 48);

}  // namespace isonest::detail
