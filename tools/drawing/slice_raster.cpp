#include "tools/drawing/slice_raster.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isonest::detail::cli {
namespace {

int first(double at) {
    return static_cast<int>(std::clamp(at - 1, 0.0, 1e6));
}
int last(double at, int size) {
    return static_cast<int>(std::clamp(at + 1, -1.0, static_cast<double>(size - 1)));
}

}  // namespace

SliceRaster::SliceRaster(const SliceInk& ink, int width, int first_row, int rows)
    : ink_(ink),
      width_(width * kStep),
      begin_(first_row * kStep),
      end_((first_row + rows) * kStep),
      pixels_(std::size_t{3} * static_cast<std::size_t>(width_) *
                  static_cast<std::size_t>(end_ - begin_),
              std::uint8_t{255}) {}

void SliceRaster::draw(const std::array<Flat, 3>& t) {
    const double area =
        (t[1].x - t[0].x) * (t[2].y - t[0].y) - (t[1].y - t[0].y) * (t[2].x - t[0].x);
    if (area == 0 || !std::isfinite(area)) {
        return;
    }
    const auto [x0, x1] = std::minmax({t[0].x, t[1].x, t[2].x});
    const auto [y0, y1] = std::minmax({t[0].y, t[1].y, t[2].y});
    if (!(y0 - 1 <= end_ && y1 + 1 >= begin_)) {
        return;
    }
    std::array<double, 3> edge_length{};
    for (std::size_t i = 0; i < 3; ++i) {
        const Flat& a = t[(i + 1) % 3];
        const Flat& b = t[(i + 2) % 3];
        edge_length[i] = std::hypot(b.x - a.x, b.y - a.y);
    }
    const double slope_x = ((t[1].value - t[0].value) * (t[2].y - t[0].y) -
                            (t[2].value - t[0].value) * (t[1].y - t[0].y)) /
                           area;
    const double slope_y = ((t[2].value - t[0].value) * (t[1].x - t[0].x) -
                            (t[1].value - t[0].value) * (t[2].x - t[0].x)) /
                           area;
    const double slope = std::hypot(slope_x, slope_y);
    for (int y = std::max(first(y0), begin_); y <= last(y1, end_); ++y) {
        for (int x = first(x0); x <= last(x1, width_); ++x) {
            std::array<double, 3> w{};
            double to_edge = std::numeric_limits<double>::infinity();
            double value = 0;
            for (std::size_t i = 0; i < 3; ++i) {
                const Flat& a = t[(i + 1) % 3];
                const Flat& b = t[(i + 2) % 3];
                w[i] = ((b.x - a.x) * (y + 0.5 - a.y) - (b.y - a.y) * (x + 0.5 - a.x)) / area;
                to_edge = std::min(to_edge, w[i] * std::fabs(area) / edge_length[i]);
                value += w[i] * t[i].value;
            }
            if (std::min({w[0], w[1], w[2]}) >= -1e-9) {
                put(x, y, shade(value, to_edge, slope));
            }
        }
    }
}

std::vector<std::uint8_t> SliceRaster::reduced() const {
    std::vector<std::uint8_t> rgb;
    rgb.reserve(pixels_.size() / (kStep * kStep));
    for (int y = begin_; y < end_; y += kStep) {
        for (int x = 0; x < width_; x += kStep) {
            for (std::size_t c = 0; c < 3; ++c) {
                int sum = kStep * kStep / 2;
                for (int i = 0; i < kStep * kStep; ++i) {
                    sum += pixels_[place(x + i % kStep, y + i / kStep) + c];
                }
                rgb.push_back(static_cast<std::uint8_t>(sum / (kStep * kStep)));
            }
        }
    }
    return rgb;
}

/// A contour line is dark with a white border: it is seen on every map.
Rgb SliceRaster::shade(double value, double to_edge, double slope) const {
    const double range = ink_.high - ink_.low;
    Rgb color = ink_.map.color(range > 0 ? (value - ink_.low) / range : 0.5);
    if (ink_.grid && to_edge < 0.3 * kStep) {
        for (double& c : color) {
            c *= 0.45;
        }
    }
    constexpr double kLine = 0.75;
    constexpr double kBorder = 1.6;
    double nearest = std::numeric_limits<double>::infinity();
    for (const double contour : ink_.contours) {
        nearest = std::min(nearest, std::fabs(value - contour));
    }
    if (slope > 0 && nearest <= kBorder * kStep * slope) {
        color = nearest <= kLine * kStep * slope ? Rgb{20, 20, 20} : Rgb{255, 255, 255};
    }
    return color;
}

void SliceRaster::put(int x, int y, const Rgb& color) {
    for (std::size_t c = 0; c < 3; ++c) {
        pixels_[place(x, y) + c] = static_cast<std::uint8_t>(std::lround(color.at(c)));
    }
}

}  // namespace isonest::detail::cli
