// A slice as a picture: values as colours, optionally with the triangles' edges and contour lines.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/mesh_sink.h>

#include "tools/drawing/canvas.h"
#include "tools/drawing/picture_frame.h"

namespace isonest::detail::cli {

// Rasterisation by edge functions: J. Pineda, "A parallel algorithm for polygon rasterization",
// SIGGRAPH 1988.

/// A corner of a triangle in the picture.
struct Flat {
    double x = 0;
    double y = 0;
    double value = 0;
};

/// How values are drawn.
struct SliceInk {
    const ColorMap& map;
    double low = 0;   ///< value of the first colour
    double high = 1;  ///< value of the last colour
    bool grid = false;
    const std::vector<double>& contours;
};

/// Some rows of a picture of `width` pixels, from `first_row`, rasterised at kStep times the size
/// along each axis. White where nothing is drawn.
class SliceRaster {
  public:
    static constexpr int kStep = 2;
    SliceRaster(const SliceInk& ink, int width, int first_row, int rows);
    [[nodiscard]] int rows() const { return (end_ - begin_) / kStep; }
    /// Bytes per row, including the row in the file's format.
    static std::uint64_t row_heap(int width) {
        // The frame's pixels take four bytes each.
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
    int begin_;  ///< in rasterised rows
    int end_;
    std::vector<std::uint8_t> pixels_;
};

// The places where values of contour lines are written.

struct ContourLabel {
    double x = 0;  ///< pixels
    double y = 0;
    double turn = 0;  ///< along the line, in radians, readable from below
    double value = 0;
};

/// Keeps a bounded number of places per contour, whatever its length. The choice depends only on
/// the triangles, not on their order.
class ContourLabels {
  public:
    ContourLabels(const Rectangle& r, const std::vector<double>& contours);
    /// Corners in pixels.
    void add(const std::array<Flat, 3>& triangle);
    /// At most kMaxEach for each contour, without overlaps; `size` of the letters.
    [[nodiscard]] std::vector<ContourLabel> choose(double size) const;
    static constexpr std::size_t kMaxEach = 2;

  private:
    static constexpr std::size_t kCells = 12;  ///< per axis; each cell keeps one place
    struct Place {
        ContourLabel label;
        double distance = 0;  ///< from the centre of the cell
    };
    Rectangle r_;
    std::vector<double> contours_;
    std::vector<std::optional<Place>> places_;  ///< [contour][cell]
};

struct SlicePictureOptions {
    int width = 800;          ///< pixels
    int height = 800;         ///< pixels
    Double3 normal{0, 0, 1};  ///< of the plane; the viewer is on the side that it points to
    double low = 0;           ///< value of the first colour
    double high = 1;          ///< value of the last colour
    std::string colors = "viridis";
    bool grid = false;             ///< draw the triangles' edges
    bool plain = false;            ///< no axes and no colour bar
    std::vector<double> contours;  ///< values of the contour lines
    std::uint64_t memory = std::uint64_t{256}
                           << 20U;  ///< bytes of pixels held; at least one row is
};

/// Pictures with a shorter side are always plain.
inline constexpr int kMinFramed = 240;

/// Draws a plane mesh with vertex values, fitted, on white, into an 8-bit RGB PNG, which replaces
/// an existing one. Around it are axes in the mesh's unit (in an oblique plane, distances along the
/// plane's directions), a colour bar, and values of contour lines. The picture is drawn in strips
/// that fit into the memory, each in one pass over the mesh.
class SlicePicture : public MeshSink {
  public:
    /// Throws Error{invalid_argument} for an unknown colour map.
    SlicePicture(std::filesystem::path png, SlicePictureOptions options);
    /// Throws Error{invalid_argument, not_found} if the picture cannot be written there.
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    /// These throw Error{io}. REQUIRES: the layout has values.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    void end() override;

  private:
    /// In the plane's coordinates.
    struct Extent {
        std::array<double, 2> low;
        std::array<double, 2> high;
    };
    SliceRaster& raster();
    [[nodiscard]] bool framed() const;
    /// Where the slice is drawn, and the number of pixels per world unit.
    [[nodiscard]] Rectangle place() const;
    [[nodiscard]] double scale() const;
    void frame(Canvas& canvas) const;

    std::filesystem::path path_;
    SlicePictureOptions options_;
    ColorMap map_;
    std::unique_ptr<PngFile> file_;
    VertexAttribute value_;
    std::optional<LengthUnit> unit_;
    Extent extent_{};
    int row_ = 0;  ///< the first row of the strip
    std::unique_ptr<SliceRaster> raster_;
    std::unique_ptr<ContourLabels> labels_;
    std::vector<ContourLabel> chosen_;
};

}  // namespace isonest::detail::cli
