// A slice as a picture: colours for values, the triangles' edges and contour lines on request.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/mesh_sink.h>

#include "tools/drawing/color_maps.h"
#include "tools/drawing/contour_labels.h"
#include "tools/drawing/picture_frame.h"
#include "tools/drawing/png_writer.h"
#include "tools/drawing/slice_raster.h"

namespace isonest::detail::cli {

struct SlicePictureOptions {
    int width = 800;          ///< pixels
    int height = 800;         ///< pixels
    Double3 normal{0, 0, 1};  ///< of the plane; the picture is seen from where it points to
    double low = 0;           ///< value of the first colour
    double high = 1;          ///< value of the last colour
    std::string colors = "viridis";
    bool grid = false;             ///< draw the triangles' edges
    bool plain = false;            ///< neither axes nor a bar of the colours
    std::vector<double> contours;  ///< values at which lines are drawn
    std::uint64_t memory = std::uint64_t{256}
                           << 20U;  ///< bytes of pixels held; at least one row is
};

/// Pictures with a shorter side are always plain.
inline constexpr int kLeastFramed = 240;

/// Draws a mesh that lies in a plane and has vertex values, fitted, with white around it, into an
/// 8-bit RGB PNG, which replaces what is there. Beside it are axes in the mesh's unit (in an
/// oblique plane distances along its own directions), a bar of the colours, and values of contour
/// lines. The picture is drawn in strips that fit into the memory, each in one pass over the mesh.
class SlicePicture : public MeshSink {
  public:
    /// Throws Error{invalid_argument} if there are no such colours.
    SlicePicture(std::filesystem::path png, SlicePictureOptions options);
    /// Throws Error{invalid_argument, not_found} where no picture may be written.
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    /// These throw Error{io}. REQUIRES: the layout has values.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    void end() override;

  private:
    /// In the plane's own coordinates.
    struct Extent {
        std::array<double, 2> low;
        std::array<double, 2> high;
    };
    SliceRaster& raster();
    [[nodiscard]] bool framed() const;
    /// Where the slice is drawn, and how many pixels a world unit has.
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
    int row_ = 0;  ///< the first of the strip
    std::unique_ptr<SliceRaster> raster_;
    std::unique_ptr<ContourLabels> labels_;
    std::vector<ContourLabel> chosen_;
};

}  // namespace isonest::detail::cli
