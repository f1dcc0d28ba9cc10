#include "query/tiles/tile_levels.h"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "query/tiles/coarser_tile.h"
#include "store/base/in_order.h"

namespace isonest::detail {

/// The tiles below a cube.
struct TileLevels::Family {
    std::uint32_t number = 0;  ///< of the cube
    std::span<const TileRecord> tiles = {};
};

struct TileLevels::Made {
    TileRecord record;
    std::vector<TileTriangle> triangles;
    std::uint64_t bytes = 0;
};

namespace {

void add_to(TileLevel& level, const TileRecord& tile, std::uint64_t bytes) {
    level.triangles += tile.triangles;
    level.bytes += bytes;
    (tile.triangles > 0 ? level.tiles : level.without_mesh) += 1;
    level.bound = std::max(level.bound, tile.triangles > 0 ? tile.error : 0);
}

/// Extends the box of a tile by that of another.
void add_box(TileRecord& tile, const TileRecord& other) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        tile.low[axis] = std::min(tile.low[axis], other.low[axis]);
        tile.high[axis] = std::max(tile.high[axis], other.high[axis]);
    }
}

}  // namespace

TileLevels::TileLevels(std::unique_ptr<CutTiles> cut, const TileLimits& limits,
                       const ScratchFolder& folder, Write write, Progress& progress)
    : cut_(std::move(cut)),
      grid_(cut_->grid()),
      limits_(limits),
      folder_(folder),
      write_(std::move(write)),
      progress_(progress) {}

std::vector<TileLevel> TileLevels::make() {
    std::vector<TileLevel> levels{make_finest()};
    for (int level = 1; records_.back()->size() > 1; ++level) {
        levels.push_back(make_level(level));
    }
    return levels;
}

/// Also sets the box of the mesh.
void TileLevels::write(Made& made, const TileMesh& mesh, int level) const {
    TileRecord& record = made.record;
    record.triangles = static_cast<std::uint32_t>(mesh.triangles.size());
    const Double3 low = grid_.low_of(record.number, level);
    const Double3 step = grid_.step(level);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto [least, most] =
            std::minmax_element(mesh.vertices.begin(), mesh.vertices.end(),
                                [&](const TileMesh::Vertex& a, const TileMesh::Vertex& b) {
                                    return a.at[axis] < b.at[axis];
                                });
        record.low[axis] = low[axis] + least->at[axis] * step[axis];
        record.high[axis] = low[axis] + most->at[axis] * step[axis];
    }
    made.bytes = write_(mesh, record.number, level);
}

TileLevels::Made TileLevels::finest(std::uint32_t cube) const {
    Made made;
    TileMesh mesh = tile_mesh(cut_->of(cube));
    made.record.number = cube;
    made.record.error = limits_.bound + cut_->error(cube);
    if (widen_lines(mesh)) {
        made.record.error += length(grid_.step(0));
    }
    write(made, mesh, 0);
    return made;
}

TileLevel TileLevels::make_finest() {
    GrowingFile<std::uint32_t> cubes(folder_);
    std::uint64_t triangles = 0;
    for (std::uint32_t cube = 0; cube < cut_->cubes(); ++cube) {
        if (const std::size_t count = cut_->of(cube).size(); count > 0) {
            cubes.append(cube);
            triangles += count;
        }
    }
    cubes.seal();
    TileLevel level;
    auto records = std::make_unique<TileRecords>(folder_);
    progress_.begin("write tiles", triangles, "triangles");
    in_order(
        static_cast<std::int64_t>(cubes.size()), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress_.check();
            const std::uint32_t cube = cubes.all()[static_cast<std::size_t>(i)];
            Made made = finest(cube);
            progress_.advance(cut_->of(cube).size());
            return made;
        },
        [&](std::int64_t /*i*/, const Made& made) {
            records->append(made.record);
            add_to(level, made.record, made.bytes);
        });
    records->seal();
    records_.push_back(std::move(records));
    return level;
}

/// The mesh in the tile's file.
TileMesh TileLevels::mesh_of(const TileRecord& tile, int level) const {
    if (level > 0) {
        return tile_mesh(triangles_->all().subspan(tile.first, tile.triangles));
    }
    TileMesh mesh = tile_mesh(cut_->of(tile.number));
    widen_lines(mesh);
    return mesh;
}

TileLevels::Made TileLevels::coarser(const Family& family, int level) const {
    Made made;
    TileRecord& record = made.record;
    record = family.tiles.front();
    record.number = family.number;
    record.triangles = 0;
    std::uint64_t triangles = 0;
    bool is_whole = true;
    for (const TileRecord& tile : family.tiles) {
        triangles += tile.triangles;
        is_whole = is_whole && tile.triangles > 0;
        record.error = std::max(record.error, tile.error);
        add_box(record, tile);
    }
    if (!is_whole) {
        return made;
    }
    const Double3 step = grid_.step(level - 1);
    const double limit = std::ldexp(limits_.error, level) - record.error;
    double used = 0;  // of the limit
    std::vector<TileMesh> meshes;
    if (triangles > kMaxJoined) {
        // They are simplified before they are joined, which leaves more triangles at the same
        // error.
        triangles = 0;
        for (const TileRecord& tile : family.tiles) {
            SimplifiedTile alone = simplified_alone(mesh_of(tile, level - 1), step, limit / 2);
            used = std::max(used, alone.error);
            triangles += alone.mesh.triangles.size();
            if (triangles > kMaxJoined) {
                return made;
            }
            meshes.push_back(std::move(alone.mesh));
        }
    }
    CoarserTile joined(step, limit - used);
    for (std::size_t i = 0; i < family.tiles.size(); ++i) {
        joined.add(meshes.empty() ? mesh_of(family.tiles[i], level - 1) : meshes[i],
                   cube_at(family.tiles[i].number & 7U));
    }
    const SimplifiedTile result = joined.finish();
    if (result.mesh.triangles.size() > kMaxInTile) {
        return made;
    }
    record.error += used + result.error;
    const TileRecord below = record;
    write(made, result.mesh, level);
    add_box(record, below);
    made.triangles = detail::triangles_of(result.mesh, record.number);
    return made;
}

TileLevel TileLevels::make_level(int number) {
    const std::span<const TileRecord> below = records_.back()->all();
    // Tiles with the same number but for its last three bits are below the same cube.
    GrowingFile<std::uint64_t> firsts(folder_);
    std::uint64_t triangles = 0;
    for (std::size_t i = 0; i < below.size(); ++i) {
        triangles += below[i].triangles;
        if (i == 0 || below[i].number / 8 != below[i - 1].number / 8) {
            firsts.append(i);
        }
    }
    firsts.seal();
    const std::size_t families = firsts.size();
    TileLevel level;
    auto records = std::make_unique<TileRecords>(folder_);
    auto kept = std::make_unique<Triangles>(folder_);
    progress_.begin("simplify tiles", triangles, "triangles");
    in_order(
        static_cast<std::int64_t>(families), tbb::this_task_arena::max_concurrency() + 1,
        [&](std::int64_t i) {
            progress_.check();
            const auto at = static_cast<std::size_t>(i);
            const std::uint64_t first = firsts.all()[at];
            const std::uint64_t end = at + 1 < families ? firsts.all()[at + 1] : below.size();
            const Family family{below[first].number / 8, below.subspan(first, end - first)};
            Made made = coarser(family, number);
            std::uint64_t joined = 0;
            for (const TileRecord& tile : family.tiles) {
                joined += tile.triangles;
            }
            progress_.advance(joined);
            return made;
        },
        [&](std::int64_t /*i*/, Made& made) {
            made.record.first = kept->size();
            for (const TileTriangle& triangle : made.triangles) {
                kept->append(triangle);
            }
            records->append(made.record);
            add_to(level, made.record, made.bytes);
        });
    records->seal();
    kept->seal();
    triangles_ = std::move(kept);
    cut_.reset();
    records_.push_back(std::move(records));
    return level;
}

}  // namespace isonest::detail
