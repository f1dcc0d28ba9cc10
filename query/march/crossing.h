// How a tetrahedron is crossed by the surface.
#pragma once

#include <array>
#include <cstdint>

namespace isonest::detail {

struct Crossing {
    int below = 0;  ///< how many corners are below the isovalue
    /// The corners: the one that is alone on its side first, or the two that are not below.
    std::array<std::uint8_t, 4> order{};
    bool flip = false;  ///< the order turns the tetrahedron inside out
};

/// By the corners that are below (bits 0 to 3).
constexpr std::array<Crossing, 16> make_crossings() {
    std::array<Crossing, 16> crossings{};
    for (unsigned mask = 0; mask < crossings.size(); ++mask) {
        Crossing& c = crossings[mask];
        for (unsigned i = 0; i < 4; ++i) {
            c.below += static_cast<int>((mask >> i) & 1U);
        }
        const unsigned first = c.below == 1 ? 1 : 0;
        std::size_t n = 0;
        for (const unsigned side : {first, 1 - first}) {
            for (std::uint8_t i = 0; i < 4; ++i) {
                if (((mask >> i) & 1U) == side) {
                    c.order[n++] = i;
                }
            }
        }
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t j = i + 1; j < 4; ++j) {
                c.flip = c.flip != (c.order[i] > c.order[j]);
            }
        }
    }
    return crossings;
}
inline constexpr std::array<Crossing, 16> kCrossings = make_crossings();

}  // namespace isonest::detail
