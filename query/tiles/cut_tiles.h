// The tiles at the finest level: meshes, cut at the faces of cubes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>
#include <isonest/tileset.h>

#include "query/simplify/block_files.h"
#include "query/tiles/tile_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The triangles of all meshes in cubes, in temporary files.
class CutTiles {
  public:
    CutTiles(const TileGrid& grid, const ScratchFolder& folder)
        : grid_(grid), folder_(folder), triangles_(std::make_unique<Triangles>(folder)) {
        begin_errors();
    }

    /// Thread-safe. `errors`: how far rounding moved each triangle's corners at most, world units.
    void add(std::span<const TileTriangle> triangles, std::span<const float> errors);
    /// Call after all were added: sorts them, and divides cubes until each has at most kMaxInTile
    /// triangles. Throws Error{limit} if cubes would be too small, and Error{io, cancelled}.
    void finish(Progress& progress);

    // Constant after finish():

    [[nodiscard]] const TileGrid& grid() const { return grid_; }
    [[nodiscard]] std::uint32_t cubes() const { return std::uint32_t{1} << (3 * grid_.top); }
    /// In the order in which they were added.
    [[nodiscard]] std::span<const TileTriangle> of(std::uint32_t cube) const {
        return triangles_->of(cube);
    }
    /// How far rounding moved points of a cube at most, world units.
    [[nodiscard]] double error(std::uint32_t cube) const {
        return static_cast<double>(errors_->as<const float>()[cube]);
    }

  private:
    using Triangles = SortedByBlocks<TileTriangle>;
    void begin_errors();
    void divide(Progress& progress);
    [[nodiscard]] std::uint64_t largest() const;

    TileGrid grid_;
    ScratchFolder folder_;
    std::unique_ptr<Triangles> triangles_;
    std::optional<ScratchFile> errors_;  ///< a float for each cube
    std::mutex mutex_;
};

/// A volume's own axes in the world.
struct OwnAxes {
    Double3 origin{};
    Directions axes = kAlongWorld;

    [[nodiscard]] Double3 place(const Double3& world) const {
        return unrotated(axes, {world[0] - origin[0], world[1] - origin[1], world[2] - origin[2]});
    }
};

/// Cuts one mesh. `isovalues`: of the tileset's features, for meshes with isovalues.
class TileCutter : public MeshSink {
  public:
    TileCutter(CutTiles& tiles, const TileGrid& grid, const OwnAxes& own, std::uint32_t feature,
               std::vector<double> isovalues, const ScratchFolder& folder)
        : tiles_(tiles),
          grid_(grid),
          own_(own),
          feature_(feature),
          isovalues_(std::move(isovalues)),
          folder_(folder) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    [[nodiscard]] bool holds_float64() const override { return false; }
    void end() override { normals_.reset(); }

  private:
    [[nodiscard]] std::uint32_t feature_of(const ElementBatch& batch, std::size_t vertex) const;
    void sum_normals(const ElementBatch& batch);

    CutTiles& tiles_;
    TileGrid grid_;
    OwnAxes own_;
    std::uint32_t feature_;
    std::vector<double> isovalues_;
    ScratchFolder folder_;
    MeshLayout layout_;
    const VertexAttribute* normal_ = nullptr;
    const VertexAttribute* value_ = nullptr;
    const VertexAttribute* isovalue_ = nullptr;
    /// Without normals in the mesh: for each vertex, the sum over its triangles, made in a first
    /// pass.
    std::optional<ScratchFile> normals_;
    bool sums_ = false;  ///< this is that pass
};

}  // namespace isonest::detail
