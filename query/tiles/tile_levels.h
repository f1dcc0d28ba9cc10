// The levels of a tileset, from the finest to one tile.
//
//     meshes -> cut at cubes                        query/tiles/cut_tiles.h: level 0
//     up to eight tiles -> joined -> simplified     query/tiles/coarser_tile.h: level k from k - 1
//     tile -> file                                  query/tiles/tile_glb.h
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <isonest/progress.h>
#include <isonest/tileset.h>

#include "query/tiles/cut_tiles.h"
#include "query/tiles/tile_mesh.h"
#include "query/tiles/tileset_json.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

struct TileLimits {
    double bound = 0;  ///< of the meshes that were cut, world units
    double error = 0;  ///< a tile at level k is within 2^k times this; world units, >= bound
};

/// Not thread-safe; works in the caller's arena, which has as many threads as there is memory for.
class TileLevels {
  public:
    /// Writes a tile's file and returns its size. Called from many threads.
    using Write =
        std::function<std::uint64_t(const TileMesh& mesh, std::uint32_t number, int level)>;

    /// `cut`: after its finish(); it is freed when it is not needed any more.
    TileLevels(std::unique_ptr<CutTiles> cut, const TileLimits& limits, const ScratchFolder& folder,
               Write write, Progress& progress);

    /// Makes level 0, then further ones until a level has only one tile. Throws Error{io,
    /// cancelled}.
    std::vector<TileLevel> make();

    [[nodiscard]] const TileGrid& grid() const { return grid_; }
    /// After make(): the tiles of each level.
    [[nodiscard]] std::span<const std::unique_ptr<TileRecords>> records() const { return records_; }

  private:
    struct Family;
    struct Made;
    TileLevel make_finest();
    TileLevel make_level(int level);
    [[nodiscard]] Made finest(std::uint32_t cube) const;
    [[nodiscard]] Made coarser(const Family& family, int level) const;
    [[nodiscard]] TileMesh mesh_of(const TileRecord& tile, int level) const;
    void write(Made& made, const TileMesh& mesh, int level) const;

    std::unique_ptr<CutTiles> cut_;
    TileGrid grid_;
    TileLimits limits_;
    ScratchFolder folder_;
    Write write_;
    Progress& progress_;
    std::vector<std::unique_ptr<TileRecords>> records_;
    using Triangles = GrowingFile<TileTriangle>;
    std::unique_ptr<Triangles> triangles_;  ///< of the level that was made last, from level 1 on
};

}  // namespace isonest::detail
