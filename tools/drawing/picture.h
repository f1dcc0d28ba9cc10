// Pictures of meshes, drawn off screen by OSMesa.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "tools/drawing/input/ply_reader.h"

namespace isonest::detail::cli {

inline constexpr int kMaxPixels = 4096;  ///< per axis

/// An output file, and its direction of view.
struct PictureView {
    std::filesystem::path png;
    Double3 view{1.0, -1.6, 0.9};  ///< from the mesh toward the eye; not zero; z is up
};

struct PictureOptions {
    int width = 800;                          ///< pixels, 1 to kMaxPixels
    int height = 600;                         ///< pixels, 1 to kMaxPixels
    bool wireframe = false;                   ///< also draw the triangles' edges
    bool flat = false;                        ///< one shade per triangle
    bool plain = false;                       ///< no darkened hollows, no scale bar, no text
    std::array<int, 3> color{110, 156, 204};  ///< of the surface, 0 to 255
    /// Colour by the mesh's values, or by its vertex colours, if it has any.
    bool by_values = true;
    std::string colors = "viridis";  ///< for values
    /// Values of the first and the last colour.
    std::optional<std::pair<double, double>> range = {};
    /// Maximum heap in bytes. A picture that does not fit is drawn in strips, each in one pass over
    /// the mesh; if one normal per vertex does not fit, shading becomes flat.
    std::uint64_t memory = std::uint64_t{1} << 30U;
};

struct PictureReport {
    bool smooth = false;
    Double3 lo{};  ///< bounding box of the vertices in world units; all 0 without vertices
    Double3 hi{};
    std::optional<std::pair<double, double>> range = {};  ///< set if values are shown in colours
};

/// Draws the mesh on a light background, fitted to the picture, in an orthographic view, and writes
/// PNG files (8-bit RGB), replacing existing ones; all at the same scale. The mesh is streamed,
/// never in memory as a whole. Hollows are darkened. Pictures with at least kMinNoted pixels on
/// each side have a scale bar, the world's directions, and a colour bar if values are shown.
/// Throws Error{invalid_argument, limit, io, cancelled} and what PlyMesh throws.
PictureReport draw_pictures(const PlyMesh& mesh, const std::vector<PictureView>& views,
                            const PictureOptions& options, Progress& progress);
inline constexpr int kMinNoted = 240;

}  // namespace isonest::detail::cli
