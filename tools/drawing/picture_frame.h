// What stands around and in pictures of data: axes, colour bars, a scale bar, the directions.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "tools/drawing/canvas.h"
#include "tools/drawing/color_maps.h"

namespace isonest::detail::cli {

/// Pixels, from the top left.
struct Rectangle {
    double left = 0;
    double top = 0;
    double right = 0;
    double bottom = 0;
};

/// Numbers of the form 1, 2 or 5 times a power of ten between low and high, about `wanted`. No I/O.
std::vector<double> round_ticks(double low, double high, int wanted);
/// As few digits as tell neighbouring ticks apart.
std::string tick_text(double value);

/// A line around the rectangle with ticks at its left and bottom side, and the axes' names.
struct AxisText {
    std::string name;
    double low = 0;  ///< at the left, or the bottom
    double high = 1;
};
void draw_axes(Canvas& canvas, const Rectangle& r, const AxisText& x, const AxisText& y,
               double size);

/// The colours of values from bottom to top, with ticks at the right side and marks at `marks`.
void draw_color_bar(Canvas& canvas, const Rectangle& r, const ColorMap& map, double low,
                    double high, const std::vector<double>& marks, double size);

/// A bar of a round length, at most `most` pixels, whose left end is at (x, y), with its length in
/// world units over it.
void draw_scale_bar(Canvas& canvas, double x, double y, double most, double pixels_per_unit,
                    double size);

/// The world's axes x, y, z around (x, y): `right` and `up` are the picture's, in the world.
void draw_directions(Canvas& canvas, double x, double y, double length, const Double3& right,
                     const Double3& up, double size);

}  // namespace isonest::detail::cli
