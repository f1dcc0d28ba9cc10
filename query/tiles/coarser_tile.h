// A tile from the tiles below it.
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <cstdint>
#include <vector>

#include "query/simplify/patch.h"
#include "query/simplify/simplify_patch.h"
#include "query/tiles/tile_mesh.h"

namespace isonest::detail {

/// Heap that a thread needs for one tile.
std::uint64_t coarser_tile_heap();

struct SimplifiedTile {
    TileMesh mesh;
    double error = 0;  ///< proven distance from the tile or tiles in both directions, world units
};

/// Simplifies a tile alone, within `limit` of what it was (world units); its border is kept.
/// `step`: of the tile, world units. REQUIRES: not more than kMaxInTile triangles. Thread-safe.
SimplifiedTile simplified_alone(const TileMesh& tile, const Double3& step, double limit);

/// Joins up to eight tiles and simplifies them, in two steps, so that the first needs little memory
/// and the second has little work: each tile with its border, then all together with the border of
/// the cube. Both measure from the tiles as they were. Not thread-safe.
class CoarserTile {
  public:
    /// `step`: of the tiles below, world units. `limit`: largest distance from them, world units.
    CoarserTile(const Double3& step, double limit);

    /// `place`: of the tile in the cube, 0 or 1 along each axis. REQUIRES: not more than kMaxInTile
    /// triangles, and not more than kMaxJoined in all tiles.
    void add(const TileMesh& tile, const std::array<std::uint32_t, 3>& place);

    /// Call once. Rounds coordinates to steps of the cube's level, which are twice as long.
    SimplifiedTile finish();

  private:
    [[nodiscard]] std::uint32_t number_of(const TileMesh::Vertex& vertex);
    void take(const TileMesh& tile, const SimplifiedPatch& simplified,
              const std::vector<std::uint32_t>& numbers);

    /// Vertices at the same place of different features are different.
    struct Place {
        Steps at{};
        std::uint32_t feature = 0;
        bool operator==(const Place&) const = default;
    };
    struct PlaceHash {
        std::size_t operator()(const Place& place) const;
    };

    Double3 step_;
    double limit_;    ///< for both steps, without what rounding needs
    double reserve_;  ///< what rounding to float32 needs
    std::vector<TileMesh::Vertex> vertices_;
    std::vector<bool> moved_;  ///< of the vertices: their coordinates are those of the patch alone
    tsl::robin_map<Place, std::uint32_t, PlaceHash> numbers_;
    Patch joined_;
    double largest_ = 0;
};

}  // namespace isonest::detail
