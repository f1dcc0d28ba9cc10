#include "tools/drawing/ambient_occlusion.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace isonest::detail::cli {
namespace {

constexpr int kPairs = 6;       ///< pairs of opposite directions
constexpr int kSteps = 6;       ///< samples in each direction
constexpr double kDark = 0.85;  ///< darkening of a place that sees none of the sky

/// The elevation angle of the horizon in a direction; negative if the surface falls everywhere.
double horizon(const DepthImage& image, int x, int y, double dx, double dy, double radius) {
    const auto at = [&](int px, int py) {
        return image.depth[static_cast<std::size_t>(py) * static_cast<std::size_t>(image.width) +
                           static_cast<std::size_t>(px)];
    };
    const auto here = static_cast<double>(at(x, y));
    double steepest = -1e9;
    double before = 0;
    for (int step = 1; step <= kSteps; ++step) {
        // Nearer samples are closer together.
        const double r = radius * (static_cast<double>(step * step) / (kSteps * kSteps));
        const double reach = std::max(r, before + 1);
        before = reach;
        const int px = x + static_cast<int>(std::lround(dx * reach));
        const int py = y + static_cast<int>(std::lround(dy * reach));
        if (reach > radius || px < 0 || py < 0 || px >= image.width || py >= image.height) {
            break;
        }
        const auto there = static_cast<double>(at(px, py));
        if (there >= 1) {
            continue;
        }
        double rise = (here - there) * image.pixels / reach;
        // A surface far in front casts less shadow than the surface itself.
        constexpr double kFarther = 3;
        if (rise > kFarther) {
            rise = kFarther * kFarther / rise;
        }
        steepest = std::max(steepest, rise);
    }
    return steepest < -1e8 ? -std::numbers::pi / 2 : std::atan(steepest);
}

}  // namespace

void darken_hollows(const DepthImage& image, double radius, int begin, int end,
                    std::span<std::uint8_t> rgba) {
    tbb::parallel_for(begin, end, [&](int y) {
        for (int x = 0; x < image.width; ++x) {
            const std::size_t at =
                static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                static_cast<std::size_t>(x);
            if (image.depth[at] >= 1) {
                continue;
            }
            // Neighbouring pixels use other directions; averaging pixels combines them.
            const double turn = ((x & 1) * 2 + (y & 1)) / 4.0;
            double hidden = 0;
            for (int pair = 0; pair < kPairs; ++pair) {
                const double angle = std::numbers::pi * (pair + turn) / kPairs;
                const double dx = std::cos(angle);
                const double dy = std::sin(angle);
                const double both =
                    horizon(image, x, y, dx, dy, radius) + horizon(image, x, y, -dx, -dy, radius);
                hidden += std::clamp(both / std::numbers::pi, 0.0, 1.0);
            }
            const double light = 1 - kDark * hidden / kPairs;
            for (std::size_t c = 0; c < 3; ++c) {
                std::uint8_t& value = rgba[4 * at + c];
                value = static_cast<std::uint8_t>(std::lround(value * light));
            }
        }
    });
}

}  // namespace isonest::detail::cli
