// A slice as a picture: colours for values, the triangles' edges and contour lines on request.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "tools/drawing/ply_reader.h"

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

/// Draws a mesh that lies in a plane and has vertex values, fitted, with white around it, and
/// writes an 8-bit RGB PNG. The mesh is streamed. Throws Error{invalid_argument, io, cancelled} and
/// what PlyMesh throws.
void draw_slice(const PlyMesh& mesh, const std::filesystem::path& png,
                const SlicePictureOptions& options, Progress& progress);

}  // namespace isonest::detail::cli
