// The glTF file of a tile.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/tileset.h>

#include "query/tiles/tile_mesh.h"

namespace isonest::detail {

/// What all tiles of a tileset have in common.
struct TileStyle {
    std::string title = {};
    std::optional<LabelColor> color = {};
    std::span<const TileFeature> features = {};
    /// Name of the attribute in which the vertices' values are stored, "_VALUE" for example; empty:
    /// they have none.
    std::string value = {};
    std::optional<VertexColors> colors = {};
    double metres = 1;  ///< one world unit
};

/// A binary glTF 2.0 file: positions, normals and colours in whole numbers
/// (KHR_mesh_quantization), packed with EXT_meshopt_compression if possible; with several features
/// EXT_mesh_features and EXT_structural_metadata. `low`: of the tile's cube, world units, from the
/// grid's origin; `step`: of the mesh, world units. y is up, as in all glTF files. Thread-safe.
std::string tile_glb(const TileMesh& mesh, const Double3& low, const Double3& step,
                     const TileStyle& style);

}  // namespace isonest::detail
