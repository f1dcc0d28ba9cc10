// The canvas for plots: lines, areas and text, written as SVG or PNG.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail::cli {

// Colour maps, by their usual names.

using Rgb = std::array<double, 3>;  ///< 0 to 255

/// Thread-safety: const methods from any thread.
class ColorMap {
  public:
    /// One of color_map_names(); the suffix "_r" reverses it. Throws Error{invalid_argument};
    /// `option` is named in the message.
    ColorMap(const std::string& name, const std::string& option);
    /// The colour for t from 0 to 1; t is clamped to this range.
    [[nodiscard]] Rgb color(double t) const;

  private:
    std::vector<Rgb> colors_;  ///< evenly spaced
};

/// Sources: color_map_tables.inc.
std::vector<std::string> color_map_names();

// PNG files.

/// Whether the name ends with .png, in any case.
bool is_png(const std::filesystem::path& path);

/// An image of 8-bit RGB pixels that is written row by row; only a few rows are in memory. The file
/// appears only when it is complete, and then replaces an existing one. Thread-safety: one thread.
class PngFile {
  public:
    /// Throws Error{io, invalid_argument, not_found}.
    PngFile(const std::filesystem::path& path, int width, int height);
    PngFile(const PngFile&) = delete;
    PngFile& operator=(const PngFile&) = delete;
    ~PngFile();
    /// Writes the next rows, from the top. REQUIRES: whole rows. Throws Error{io}.
    void write(std::span<const std::uint8_t> rgb);
    /// REQUIRES: all rows were written. Throws Error{io, invalid_argument}.
    void finish();

  private:
    struct State;
    [[noreturn]] void fail();
    std::filesystem::path path_;
    std::size_t row_bytes_;
    std::unique_ptr<State> state_;
};

}  // namespace isonest::detail::cli

struct _cairo;  // NOLINT(bugprone-reserved-identifier): as Cairo has named it

namespace isonest::detail::cli {

using Color = std::array<double, 3>;  ///< red, green, blue, 0 to 1

/// Coordinates in pixels, from the top left. Thread-safety: one thread.
class Canvas {
  public:
    explicit Canvas(_cairo* context);
    /// Sets the colour of everything that follows.
    void color(const Color& c);
    void line(double x0, double y0, double x1, double y1, double width, bool dashed = false);
    /// A line through the points; `dashes` are the lengths of dashes and gaps in turn; empty:
    /// solid.
    void path(const std::vector<std::array<double, 2>>& points, double width,
              const std::vector<double>& dashes = {});
    /// A marker around (x, y), one of kMarkers kinds.
    void marker(double x, double y, int kind);
    static constexpr int kMarkers = 6;
    void area(double x0, double y0, double x1, double y1);
    /// `anchor`: the part of the text that is left of x: 0, 0.5 (centred) or 1; `turn` in radians.
    void text(double x, double y, const std::string& words, double size, double anchor,
              double turn = 0);
    /// The same in the current colour with a white outline, readable on any background.
    void text_on_picture(double x, double y, const std::string& words, double size, double anchor,
                         double turn = 0);
    /// Width of the text in pixels.
    [[nodiscard]] double width_of(const std::string& words, double size);

  private:
    _cairo* context_;
};

/// Draws onto existing rows of an image: RGB, 8 bits, `rows` whole rows from `first_row`. Throws
/// Error{io}.
void draw_over(std::vector<std::uint8_t>& rgb, int width, int first_row, int rows,
               const std::function<void(Canvas&)>& draw);

/// Whether draw_canvas() can write a file of that name: .svg or .png.
bool is_canvas(const std::filesystem::path& path);

/// Draws on white; the file appears only when it is complete. Throws Error{io}, and
/// Error{invalid_argument} for other file name extensions.
void draw_canvas(const std::filesystem::path& path, int width, int height,
                 const std::function<void(Canvas&)>& draw);

}  // namespace isonest::detail::cli
