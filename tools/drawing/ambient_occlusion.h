// Darkens what lies in hollows, from the depths of a picture alone.
//
// Source: L. Bavoil, M. Sainz, R. Dimitrov, "Image-space horizon-based ambient occlusion", SIGGRAPH
// 2008 talks. The horizons of two opposite directions are taken together: what they leave of half
// a turn is how much of the sky is seen, whichever way the surface is inclined.
#pragma once

#include <cstdint>
#include <span>

namespace isonest::detail::cli {

struct DepthImage {
    std::span<const float>
        depth;  ///< distance from the eye, rows from the top; at least 1 = nothing
    int width = 0;
    int height = 0;
    double pixels = 1;  ///< of the distance from depth 0 to depth 1
};

/// Multiplies the colours (8-bit RGBA, as large as the image) of rows [begin, end) where there is a
/// surface. Looks `radius` pixels far, and depends on nothing further away. Thread-safe.
void darken_hollows(const DepthImage& image, double radius, int begin, int end,
                    std::span<std::uint8_t> rgba);

}  // namespace isonest::detail::cli
