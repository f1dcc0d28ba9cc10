// Pictures of meshes, drawn off screen by OSMesa.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "tools/drawing/ply_reader.h"

namespace isonest::detail::cli {

inline constexpr int kMostPixels = 4096;  ///< per axis

struct PictureOptions {
    int width = 800;               ///< pixels, 1 to kMostPixels
    int height = 600;              ///< pixels, 1 to kMostPixels
    Double3 view{1.0, -1.6, 0.9};  ///< from the mesh toward the eye; not zero; z points up
    bool wireframe = false;        ///< draw the triangles' edges too
    bool flat = false;             ///< one shade per triangle
    std::array<int, 3> color{86, 140, 196};  ///< of the surface, 0 to 255
    /// Bytes of heap, at most. Where the picture does not fit, it is drawn in strips, going through
    /// the mesh once for each; where one normal per vertex does not fit, shading becomes flat.
    std::uint64_t memory = std::uint64_t{1} << 30U;
};

struct PictureReport {
    bool smooth = false;
    Double3 lo{};  ///< bounding box of the vertices, world units; all 0 if there are none
    Double3 hi{};
};

/// Draws the mesh on a light background, fitted, in an orthographic view, and writes `png` (8-bit
/// RGB), replacing it. The mesh is streamed, never held.
/// Throws Error{invalid_argument, limit, io, cancelled} and what PlyMesh throws.
PictureReport draw_picture(const PlyMesh& mesh, const std::filesystem::path& png,
                           const PictureOptions& options, Progress& progress);

}  // namespace isonest::detail::cli
