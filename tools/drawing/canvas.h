// What plots are drawn on: lines, areas and words, as SVG or PNG.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

struct _cairo;  // NOLINT(bugprone-reserved-identifier): as Cairo has named it

namespace isonest::detail::cli {

using Color = std::array<double, 3>;  ///< red, green, blue, 0 to 1

/// Coordinates in pixels, from the top left. Thread-safety: one thread.
class Canvas {
  public:
    explicit Canvas(_cairo* context);
    /// Of all that follows.
    void color(const Color& c);
    void line(double x0, double y0, double x1, double y1, double width, bool dashed = false);
    /// A line through the points, with dashes and gaps of these lengths in turn, if there are any.
    void path(const std::vector<std::array<double, 2>>& points, double width,
              const std::vector<double>& dashes = {});
    /// Of kMarkers kinds, around (x, y).
    void marker(double x, double y, int kind);
    static constexpr int kMarkers = 6;
    void area(double x0, double y0, double x1, double y1);
    /// `anchor`: 0 = begins at x, 0.5 = centred, 1 = ends there; `turn` in radians.
    void text(double x, double y, const std::string& words, double size, double anchor,
              double turn = 0);
    /// The same in this colour with white around it, to be read on anything.
    void text_on_picture(double x, double y, const std::string& words, double size, double anchor,
                         double turn = 0);
    /// Of the words, pixels.
    [[nodiscard]] double width_of(const std::string& words, double size);

  private:
    _cairo* context_;
};

/// Draws onto rows of a picture that is there already: RGB, 8 bits, `rows` whole rows from
/// `first_row` on. Throws Error{io}.
void draw_over(std::vector<std::uint8_t>& rgb, int width, int first_row, int rows,
               const std::function<void(Canvas&)>& draw);

/// Whether draw_canvas() can write a file of that name: it ends with .svg or .png.
bool is_canvas(const std::filesystem::path& path);

/// Draws on white; the file appears whole or not at all. Throws Error{io}, Error{invalid_argument}
/// if the name ends otherwise.
void draw_canvas(const std::filesystem::path& path, int width, int height,
                 const std::function<void(Canvas&)>& draw);

}  // namespace isonest::detail::cli
