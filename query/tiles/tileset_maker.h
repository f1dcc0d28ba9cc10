// A tileset's files from meshes, wherever they are stored.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <isonest/tileset.h>

#include "query/tiles/cut_tiles.h"
#include "query/tiles/tile_glb.h"
#include "query/tiles/tile_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Stores a file of a tileset, such as "tiles/2/1_0_3.glb". Called from many threads, once for each
/// path.
using WriteTileFile = std::function<void(const std::string& path, const std::string& bytes)>;

/// Throws Error{invalid_argument} for options outside their ranges.
void require_options(const TilesetOptions& options);

/// As Tileset, which has the conditions and errors, without its folder. `replace` is ignored.
class TilesetMaker {
  public:
    /// `subject`: the place of errors. REQUIRES: require_options(options). Throws Error{limit} if
    /// there is too little memory, and Error{io}.
    TilesetMaker(std::filesystem::path subject, const TilesetOptions& options, WriteTileFile write);
    TilesetMaker(const TilesetMaker&) = delete;
    TilesetMaker& operator=(const TilesetMaker&) = delete;
    ~TilesetMaker();

    [[nodiscard]] std::unique_ptr<MeshSink> sink(std::size_t feature = 0);
    /// Call once. Returns the levels, finest first.
    std::vector<TileLevel> finish(const TilesetSource& source, Progress& progress);
    [[nodiscard]] std::uint64_t scratch_bytes() const { return scratch_.meter()->peak(); }

  private:
    /// Keeps what all meshes have in common. Throws Error{invalid_argument} if another mesh had
    /// other attributes.
    void take(const MeshLayout& mesh);
    [[nodiscard]] TileStyle style() const;

    std::filesystem::path subject_;
    TilesetOptions options_;
    WriteTileFile write_;
    ScratchFolder scratch_;
    OwnAxes own_;
    TileGrid grid_;
    int threads_;  ///< for which there is memory
    std::unique_ptr<CutTiles> cut_;
    std::mutex mutex_;
    std::optional<MeshLayout> layout_;  ///< of the first mesh
};

}  // namespace isonest::detail
