// Rasterisation by edge functions: J. Pineda, "A parallel algorithm for polygon rasterization",
// SIGGRAPH 1988.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "tools/drawing/color_maps.h"

namespace isonest::detail::cli {

/// A corner of a triangle in the picture.
struct Flat {
    double x = 0;
    double y = 0;
    double value = 0;
};

/// What a value looks like.
struct SliceInk {
    const ColorMap& map;
    double low = 0;   ///< value of the first colour
    double high = 1;  ///< value of the last colour
    bool grid = false;
    const std::vector<double>& contours;
};

/// Some rows of a picture of `width` pixels, from `first_row` on, drawn at kStep times its size per
/// axis. White where nothing is drawn.
class SliceRaster {
  public:
    static constexpr int kStep = 2;
    SliceRaster(const SliceInk& ink, int width, int first_row, int rows);
    [[nodiscard]] int rows() const { return (end_ - begin_) / kStep; }
    /// Bytes of a row, what is made of it for the file included.
    static std::uint64_t row_heap(int width) {
        // The frame's own pixels have four bytes.
        return static_cast<std::uint64_t>(width) * (3 * (kStep * kStep + 1) + 4);
    }
    /// Corners in pixels of the whole picture at kStep times its size, y down.
    void draw(const std::array<Flat, 3>& t);
    /// 8-bit RGB, from the top.
    [[nodiscard]] std::vector<std::uint8_t> reduced() const;

  private:
    [[nodiscard]] std::size_t place(int x, int y) const {
        return 3 * (static_cast<std::size_t>(y - begin_) * static_cast<std::size_t>(width_) +
                    static_cast<std::size_t>(x));
    }
    [[nodiscard]] Rgb shade(double value, double to_edge, double slope) const;
    void put(int x, int y, const Rgb& color);

    SliceInk ink_;
    int width_;
    int begin_;  ///< rows of pixels
    int end_;
    std::vector<std::uint8_t> pixels_;
};

}  // namespace isonest::detail::cli
