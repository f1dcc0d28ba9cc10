// Darkens hollows, using only the depth buffer of a picture.
//
// Source: L. Bavoil, M. Sainz, R. Dimitrov, "Image-space horizon-based ambient occlusion", SIGGRAPH
// 2008 talks. The horizons of two opposite directions are combined: the part of a half turn between
// them is the visible part of the sky, whatever the inclination of the surface.
#pragma once

#include <cstdint>
#include <span>

namespace isonest::detail::cli {

struct DepthImage {
    std::span<const float> depth;  ///< distance from the eye, rows from the top; >= 1 is background
    int width = 0;
    int height = 0;
    double pixels = 1;  ///< pixels per unit of depth (from 0 to 1)
};

/// Darkens the colours (8-bit RGBA, as large as the image) of rows [begin, end) where there is a
/// surface. Only depends on pixels up to `radius` pixels away. Thread-safe.
void darken_hollows(const DepthImage& image, double radius, int begin, int end,
                    std::span<std::uint8_t> rgba);

}  // namespace isonest::detail::cli
