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

inline constexpr int kMostPixels = 4096;  ///< per axis

/// A file, and from where the mesh is seen in it.
struct PictureView {
    std::filesystem::path png;
    Double3 view{1.0, -1.6, 0.9};  ///< from the mesh toward the eye; not zero; z points up
};

struct PictureOptions {
    int width = 800;                          ///< pixels, 1 to kMostPixels
    int height = 600;                         ///< pixels, 1 to kMostPixels
    bool wireframe = false;                   ///< draw the triangles' edges too
    bool flat = false;                        ///< one shade per triangle
    bool plain = false;                       ///< neither hollows darkened nor anything written
    std::array<int, 3> color{110, 156, 204};  ///< of the surface, 0 to 255
    bool by_values = true;  ///< in colours for the mesh's values, or of its vertices, if it has any
    std::string colors = "viridis";                       ///< for values
    std::optional<std::pair<double, double>> range = {};  ///< of the first and the last colour
    /// Bytes of heap, at most. Where the picture does not fit, it is drawn in strips, going through
    /// the mesh once for each; where one normal per vertex does not fit, shading becomes flat.
    std::uint64_t memory = std::uint64_t{1} << 30U;
};

struct PictureReport {
    bool smooth = false;
    Double3 lo{};  ///< bounding box of the vertices, world units; all 0 if there are none
    Double3 hi{};
    std::optional<std::pair<double, double>> range = {};  ///< if there are colours for values
};

/// Draws the mesh on a light background, fitted, in an orthographic view, and writes PNG files
/// (8-bit RGB), replacing them; all at one scale. The mesh is streamed, never held. Hollows are
/// darkened; in pictures of at least kLeastNoted pixels on each side there are a scale bar, the
/// world's directions, and, of values, their colours.
/// Throws Error{invalid_argument, limit, io, cancelled} and what PlyMesh throws.
PictureReport draw_pictures(const PlyMesh& mesh, const std::vector<PictureView>& views,
                            const PictureOptions& options, Progress& progress);
inline constexpr int kLeastNoted = 240;

}  // namespace isonest::detail::cli
