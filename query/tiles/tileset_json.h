// tileset.json, and the further tilesets of a deep octree.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/tileset.h>

#include "query/simplify/block_files.h"
#include "query/tiles/cut_tiles.h"
#include "query/tiles/tile_mesh.h"

namespace isonest::detail {

/// A tile, as it is listed.
struct TileRecord {
    std::uint32_t number = 0;     ///< of its cube
    std::uint32_t triangles = 0;  ///< 0: it has no mesh, and is only the sum of its parts
    std::uint64_t first = 0;      ///< of its triangles in those of its level
    double error = 0;             ///< proven, world units
    /// Box of its mesh and those of all tiles below, world units, from the grid's origin.
    Double3 low{};
    Double3 high{};
};

/// The tiles of a level, by ascending numbers.
using TileRecords = GrowingFile<TileRecord>;

/// "tiles/2/1_0_3.glb": the place of the file of a tile in the folder.
std::string tile_path(int level, std::uint32_t number, const char* extension);

/// A matrix for columns of coordinates, stored by columns.
using Matrix4 = std::array<double, 16>;

/// From a tangent plane (x east, y north, z up) to the earth's centre, WGS 84.
Matrix4 earth_matrix(const Georeference& place);

struct TilesetPlace {
    TileGrid grid;
    OwnAxes own;
    double metres = 1;    ///< one world unit
    bool turned = false;  ///< x and y change their signs, for the other anatomical frame
    std::optional<Georeference> georeference = {};
    std::string extras = {};  ///< members of "asset.extras"
};

/// Writes all lists of tiles with write(path, text). `levels`: finest first; the last one has one
/// tile, or none if there is no surface at all.
void write_tileset(
    const TilesetPlace& place, std::span<const std::unique_ptr<TileRecords>> levels,
    const std::function<void(const std::string& path, const std::string& text)>& write);

}  // namespace isonest::detail
