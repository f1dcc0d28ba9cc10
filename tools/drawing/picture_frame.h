// Annotations of pictures of data: axes, colour bars, a scale bar, the directions.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "tools/drawing/canvas.h"

namespace isonest::detail::cli {

// Orthographic projection from the world to the picture.

struct Bounds {
    Double3 lo{};
    Double3 hi{};
    /// Resets to an empty box.
    void start();
    void add(const Double3& p);
};

/// World to picture: x to the right, y up, z toward the eye; the longest visible side has length 2.
class PictureCamera {
  public:
    /// `view`: from the mesh toward the eye; not zero.
    explicit PictureCamera(const Double3& view);
    /// Rotates only; in world units.
    [[nodiscard]] Double3 turn(const Double3& p) const;
    /// Fits this box, in rotated coordinates, into the picture.
    void fit(const Bounds& turned);
    [[nodiscard]] Double3 place(const Double3& p) const;
    [[nodiscard]] double half_extent(std::size_t axis) const { return half_.at(axis) * scale_; }
    /// Length of a world unit in picture coordinates.
    [[nodiscard]] double scale() const { return scale_; }
    [[nodiscard]] const Double3& right() const { return right_; }
    [[nodiscard]] const Double3& up() const { return up_; }

  private:
    Double3 toward_eye_{};
    Double3 right_{};
    Double3 up_{};
    Double3 centre_{};
    Double3 half_{};
    double scale_ = 1;
};

/// In pixels, from the top left.
struct Rectangle {
    double left = 0;
    double top = 0;
    double right = 0;
    double bottom = 0;
};

/// Numbers of the form 1, 2 or 5 times a power of ten between low and high, about `wanted` of them.
/// No I/O.
std::vector<double> round_ticks(double low, double high, int wanted);
/// With as few digits as are needed to distinguish neighbouring ticks.
std::string tick_text(double value);

/// The name and range of an axis.
struct AxisText {
    std::string name;
    double low = 0;  ///< at the left or the bottom
    double high = 1;
};
void draw_axes(Canvas& canvas, const Rectangle& r, const AxisText& x, const AxisText& y,
               double size);

/// Draws a colour bar with low values at the bottom, ticks at the right side and marks at `marks`.
void draw_color_bar(Canvas& canvas, const Rectangle& r, const ColorMap& map, double low,
                    double high, const std::vector<double>& marks, double size);

/// Draws a bar of a round length, at most `most` pixels, with its left end at (x, y), and its
/// length in world units above it.
void draw_scale_bar(Canvas& canvas, double x, double y, double most, double pixels_per_unit,
                    double size);

/// Draws the world's axes x, y, z around (x, y). `right` and `up` are the picture's directions in
/// the world.
void draw_directions(Canvas& canvas, double x, double y, double length, const Double3& right,
                     const Double3& up, double size);

}  // namespace isonest::detail::cli
