#include "query/tiles/tileset_maker.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <isonest/error.h>
#include <isonest/length_unit.h>

#include "query/formats/mesh_files.h"
#include "query/tiles/coarser_tile.h"
#include "query/tiles/tile_levels.h"
#include "query/tiles/tileset_json.h"
#include "store/base/json_text.h"
#include "store/base/memory.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// About as many nodes along the edge of a cube at the finest level.
constexpr double kNodesInCube = 64;
/// If the mesh has no bound, the error of level 1 is twice this part of the distance of
/// neighbouring nodes.
constexpr double kFinestError = 0.25;

/// A mesh's way into a tileset.
class TilesetSink : public TileCutter {
  public:
    using Take = std::function<void(const MeshLayout&)>;
    TilesetSink(Take take, CutTiles& tiles, const TileGrid& grid, const OwnAxes& own,
                std::uint32_t feature, std::vector<double> isovalues, const ScratchFolder& folder)
        : TileCutter(tiles, grid, own, feature, std::move(isovalues), folder),
          take_(std::move(take)) {}
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        TileCutter::prepare(layout, inputs);
        take_(layout);
    }
    void begin(const MeshLayout& layout) override {
        take_(layout);
        TileCutter::begin(layout);
    }

  private:
    Take take_;
};

}  // namespace

void require_options(const TilesetOptions& o) {
    const auto require = [](bool holds, const char* what) {
        if (!holds) {
            throw Error(ErrorKind::invalid_argument, what);
        }
    };
    for (std::size_t axis = 0; axis < 3; ++axis) {
        require(o.spacing[axis] > 0 && std::isfinite(o.spacing[axis]),
                "the spacing must be positive");
        require(o.first[axis] <= o.last[axis] && std::isfinite(o.last[axis] - o.first[axis]),
                "the box of a tileset must have finite corners, the low one first");
    }
    require(are_directions(o.axes), "the axes of a tileset must be at right angles");
    if (const auto& g = o.georeference) {
        constexpr double kHalfTurn = 180;
        require(std::fabs(g->longitude) <= kHalfTurn && std::fabs(g->latitude) <= kHalfTurn / 2 &&
                    std::isfinite(g->height),
                "a georeference needs a longitude from -180 to 180, a latitude from -90 to 90 and "
                "a finite height");
    }
    require(o.features.size() <= 0xFFFF, "a tileset holds at most 65,535 surfaces");
    require(!o.colors || o.colors->low < o.colors->high, "the range of colours must not be empty");
}

TilesetMaker::TilesetMaker(std::filesystem::path subject, const TilesetOptions& options,
                           WriteTileFile write)
    : subject_(std::move(subject)),
      options_(options),
      write_(std::move(write)),
      scratch_(ScratchFolder::metered(options.scratch)),
      own_{options.origin, options.axes},
      grid_(TileGrid::over(options.spacing, options.first, options.last, kNodesInCube)),
      threads_(MemoryShare(subject_.string(), options.memory, Workers::count_of(options.threads))
                   .without(kLibraryHeap)
                   .threads_of(coarser_tile_heap(), "simplifying tiles")),
      cut_(std::make_unique<CutTiles>(grid_, scratch_)) {}

TilesetMaker::~TilesetMaker() = default;

void TilesetMaker::take(const MeshLayout& mesh) {
    const std::lock_guard lock(mutex_);
    layout_ = layout_.value_or(mesh);
    // Fails before any work if the frame is unknown.
    frame_in_file(layout_->frame, options_.space, subject_);
    if (options_.colors && mesh.find(options_.colors->attribute) == nullptr) {
        throw Error(ErrorKind::invalid_argument, {subject_.string()},
                    fmt::format("the mesh has no attribute '{}' for its colours",
                                options_.colors->attribute));
    }
}

TileStyle TilesetMaker::style() const {
    TileStyle style{options_.title, options_.color, options_.features, {}, options_.colors};
    if (layout_) {
        const VertexAttribute* const value = main_scalar(*layout_);
        style.value = value != nullptr ? semantic_of(*value) : "";
        style.metres = layout_->unit ? converted_length(1, *layout_->unit, LengthUnit::metre) : 1;
    }
    return style;
}

std::unique_ptr<MeshSink> TilesetMaker::sink(std::size_t feature) {
    std::vector<double> isovalues;
    for (const TileFeature& f : options_.features) {
        isovalues.push_back(f.isovalue.value_or(0));
    }
    return std::make_unique<TilesetSink>([this](const MeshLayout& layout) { take(layout); }, *cut_,
                                         grid_, own_, static_cast<std::uint32_t>(feature),
                                         std::move(isovalues), scratch_);
}

std::vector<TileLevel> TilesetMaker::finish(const TilesetSource& source, Progress& progress) {
    if (!(source.bound >= 0 && std::isfinite(source.bound))) {
        throw Error(ErrorKind::invalid_argument, {subject_.string()},
                    "the distance of the meshes from the full surface must not be negative");
    }
    const TilesetOptions& o = options_;
    const TileStyle style = this->style();
    std::vector<TileLevel> made;
    Workers(threads_).execute([&] {
        cut_->finish(progress);
        const TileGrid grid = cut_->grid();
        TileLevels levels(
            std::move(cut_),
            {source.bound,
             std::max(source.bound,
                      kFinestError * *std::min_element(o.spacing.begin(), o.spacing.end()))},
            scratch_,
            [&](const TileMesh& mesh, std::uint32_t number, int level) {
                const std::string tile =
                    tile_glb(mesh, grid.low_of(number, level), grid.step(level), style);
                write_(tile_path(level, number, "glb"), tile);
                return std::uint64_t{tile.size()};
            },
            progress);
        made = levels.make();
        TilesetPlace place{grid, own_, style.metres, false, o.georeference, {}};
        place.extras = fmt::format("\"errors_are_from\":{}", json_string(source.surface));
        if (layout_) {
            const AnatomicalFrame frame = frame_in_file(layout_->frame, o.space, subject_);
            place.turned = frame != layout_->frame;
            if (frame != AnatomicalFrame::unknown) {
                place.extras +=
                    fmt::format(R"(,"space":"{}")", frame == AnatomicalFrame::ras ? "RAS" : "LPS");
            }
        }
        write_tileset(place, levels.records(), write_);
    });
    return made;
}

}  // namespace isonest::detail
