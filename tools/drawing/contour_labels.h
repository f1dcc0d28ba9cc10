// Where the values of contour lines are written in a picture.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "tools/drawing/picture_frame.h"
#include "tools/drawing/slice_raster.h"

namespace isonest::detail::cli {

struct ContourLabel {
    double x = 0;  ///< pixels
    double y = 0;
    double turn = 0;  ///< along the line, radians, readable from below
    double value = 0;
};

/// Of each contour some places are kept, whatever its length. What is chosen depends on the
/// triangles alone, not on their order.
class ContourLabels {
  public:
    ContourLabels(const Rectangle& r, const std::vector<double>& contours);
    /// Corners in pixels.
    void add(const std::array<Flat, 3>& triangle);
    /// At most kMostEach for each contour, none on another one; `size` of the letters.
    [[nodiscard]] std::vector<ContourLabel> choose(double size) const;
    static constexpr std::size_t kMostEach = 2;

  private:
    static constexpr std::size_t kCells = 12;  ///< per axis; one place is kept in each
    struct Place {
        ContourLabel label;
        double distance = 0;  ///< from the middle of the cell
    };
    Rectangle r_;
    std::vector<double> contours_;
    std::vector<std::optional<Place>> places_;  ///< [contour][cell]
};

}  // namespace isonest::detail::cli
