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

#include "tools/drawing/png_writer.h"

namespace isonest::detail::cli {

struct SlicePictureOptions {
    int width = 800;          ///< pixels
    int height = 800;         ///< pixels
    Double3 normal{0, 0, 1};  ///< of the plane; the picture is seen from where it points to
    double low = 0;           ///< value of the first colour
    double high = 1;          ///< value of the last colour
    std::string colors = "viridis";
    bool grid = false;             ///< draw the triangles' edges
    std::vector<double> contours;  ///< values at which lines are drawn
    std::uint64_t memory = std::uint64_t{256}
                           << 20U;  ///< bytes of pixels held; at least one row is
};

/// The names for SlicePictureOptions::colors.
const std::vector<std::string>& color_map_names();

struct ColorMap;
class Raster;

/// Draws a mesh that lies in a plane and has vertex values, fitted, with white around it, into an
/// 8-bit RGB PNG, which replaces what is there. The picture is drawn in strips that fit into the
/// memory, each in one pass over the mesh.
class SlicePicture : public MeshSink {
  public:
    /// Throws Error{invalid_argument} if there are no such colours.
    SlicePicture(std::filesystem::path png, SlicePictureOptions options);
    ~SlicePicture() override;
    /// Throws Error{invalid_argument, not_found} where no picture may be written.
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    /// These throw Error{io}. REQUIRES: the layout has values.
    void begin(const MeshLayout& layout) override;
    void vertices(const VertexBatch& batch) override;
    void elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    void end() override;

  private:
    /// In the plane's own coordinates.
    struct Extent {
        std::array<double, 2> low;
        std::array<double, 2> high;
    };
    Raster& raster();

    std::filesystem::path path_;
    SlicePictureOptions options_;
    const ColorMap* map_;
    std::unique_ptr<PngFile> file_;
    VertexAttribute value_;
    Extent extent_{};
    int row_ = 0;  ///< the first of the strip
    std::unique_ptr<Raster> raster_;
};

}  // namespace isonest::detail::cli
