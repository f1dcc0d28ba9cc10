#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <mutex>
#include <utility>

#include <isonest/error.h>
#include <isonest/length_unit.h>
#include <isonest/tileset.h>

#include "query/formats/mesh_files.h"
#include "query/tiles/coarser_tile.h"
#include "query/tiles/cut_tiles.h"
#include "query/tiles/tile_glb.h"
#include "query/tiles/tile_levels.h"
#include "query/tiles/tileset_json.h"
#include "store/base/json_text.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"

namespace isonest {
namespace detail {
namespace {

/// About as many nodes along the edge of a cube at the finest level.
constexpr double kNodesInCube = 64;
/// If the mesh has no bound, the error of level 1 is twice this part of the distance of
/// neighbouring nodes.
constexpr double kFinestError = 0.25;

/// Writes files into an unfinished folder. Thread-safe.
class TileFiles {
  public:
    explicit TileFiles(std::filesystem::path folder) : folder_(std::move(folder)) {}

    /// `path`: in the folder; its folders are created. Returns the number of bytes.
    std::uint64_t write(const std::string& path, const std::string& bytes) {
        const std::filesystem::path file = folder_ / path;
        std::error_code error;
        std::filesystem::create_directories(file.parent_path(), error);
        const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        bool fails = fd < 0;
        int reason = errno;
        for (std::size_t done = 0; !fails && done < bytes.size();) {
            const ::ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
            fails = n < 0 && errno != EINTR;
            reason = errno;
            done += n > 0 ? static_cast<std::size_t>(n) : 0;
        }
        if (fd >= 0 && ::close(fd) != 0 && !fails) {
            fails = true;
            reason = errno;
        }
        if (fails) {
            throw Error(ErrorKind::io, {file.string()},
                        fmt::format("cannot be written: {}", std::strerror(reason)));
        }
        ++files_;
        bytes_ += bytes.size();
        return bytes.size();
    }
    /// Waits until everything is on the disk.
    void sync() const {
        const int fd = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        const bool fails = fd < 0 || ::syncfs(fd) != 0;
        const int reason = errno;
        if (fd >= 0) {
            ::close(fd);
        }
        if (fails) {
            throw Error(ErrorKind::io, {folder_.string()},
                        fmt::format("cannot be synced: {}", std::strerror(reason)));
        }
    }
    [[nodiscard]] std::uint64_t files() const { return files_; }
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

  private:
    std::filesystem::path folder_;
    std::atomic<std::uint64_t> files_ = 0;
    std::atomic<std::uint64_t> bytes_ = 0;
};

/// Throws Error{invalid_argument} unless the folder has only the files of a tileset.
void require_tileset(const std::filesystem::path& folder) {
    bool others = false;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        const std::filesystem::path name = entry.path().filename();
        others = others || (name != "tileset.json" && name != "tiles");
    }
    std::ifstream file(folder / "tileset.json");
    constexpr std::size_t kHead = 64;
    std::string text(kHead, ' ');
    file.read(text.data(), kHead);
    if (others || text.find(R"("generator":"isonest")") == std::string::npos) {
        throw Error(
            ErrorKind::invalid_argument, {folder.string()},
            "is a folder that holds more than a tileset made by isonest; it will not be replaced",
            {{RemedyKind::other_name}});
    }
}

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

}  // namespace
}  // namespace detail

struct Tileset::Parts {
    Parts(const std::filesystem::path& to, const TilesetOptions& o)
        : options(o),
          path(to),
          output(to, o.replace, detail::require_tileset),
          files(output.name()),
          scratch(detail::ScratchFolder::metered(o.scratch)),
          own{o.origin, o.axes},
          grid(detail::TileGrid::over(o.spacing, o.first, o.last, detail::kNodesInCube)),
          threads(detail::MemoryShare(to.string(), o.memory, detail::Workers::count_of(o.threads))
                      .without(detail::kLibraryHeap)
                      .threads_of(detail::coarser_tile_heap(), "simplifying tiles")),
          cut(std::make_unique<detail::CutTiles>(grid, scratch)) {}

    /// Keeps what all meshes have in common. Throws Error{invalid_argument} if another mesh had
    /// other attributes.
    void take(const MeshLayout& mesh);
    [[nodiscard]] detail::TileStyle style() const;

    TilesetOptions options;
    std::filesystem::path path;
    detail::OutputFolder output;
    detail::TileFiles files;
    detail::ScratchFolder scratch;
    detail::OwnAxes own;
    detail::TileGrid grid;
    int threads;  ///< for which there is memory
    std::unique_ptr<detail::CutTiles> cut;
    std::mutex mutex;
    std::optional<MeshLayout> layout;  ///< of the first mesh
};

void Tileset::Parts::take(const MeshLayout& mesh) {
    const std::lock_guard lock(mutex);
    layout = layout.value_or(mesh);
    // Fails before any work if the frame is unknown.
    detail::frame_in_file(layout->frame, options.space, path);
    if (options.colors && mesh.find(options.colors->attribute) == nullptr) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    fmt::format("the mesh has no attribute '{}' for its colours",
                                options.colors->attribute));
    }
}

detail::TileStyle Tileset::Parts::style() const {
    detail::TileStyle style{options.title, options.color, options.features, {}, options.colors};
    if (layout) {
        const VertexAttribute* const value = detail::main_scalar(*layout);
        style.value = value != nullptr ? detail::semantic_of(*value) : "";
        style.metres = layout->unit ? converted_length(1, *layout->unit, LengthUnit::metre) : 1;
    }
    return style;
}

namespace {

/// A mesh's way into a tileset.
class TilesetSink : public detail::TileCutter {
  public:
    using Take = std::function<void(const MeshLayout&)>;
    TilesetSink(Take take, detail::CutTiles& tiles, const detail::TileGrid& grid,
                const detail::OwnAxes& own, std::uint32_t feature, std::vector<double> isovalues,
                const detail::ScratchFolder& folder)
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

Tileset::Tileset(const std::filesystem::path& folder, const TilesetOptions& options) {
    detail::require_options(options);
    parts_ = std::make_unique<Parts>(folder, options);
}

Tileset::~Tileset() = default;

std::unique_ptr<MeshSink> Tileset::sink(std::size_t feature) {
    std::vector<double> isovalues;
    for (const TileFeature& f : parts_->options.features) {
        isovalues.push_back(f.isovalue.value_or(0));
    }
    return std::make_unique<TilesetSink>(
        [parts = parts_.get()](const MeshLayout& layout) { parts->take(layout); }, *parts_->cut,
        parts_->grid, parts_->own, static_cast<std::uint32_t>(feature), std::move(isovalues),
        parts_->scratch);
}

TilesetReport Tileset::finish(const TilesetSource& source, Progress& progress) {
    Parts& p = *parts_;
    if (!(source.bound >= 0 && std::isfinite(source.bound))) {
        throw Error(ErrorKind::invalid_argument, {p.path.string()},
                    "the distance of the meshes from the full surface must not be negative");
    }
    const TilesetOptions& o = p.options;
    const detail::TileStyle style = p.style();
    TilesetReport report;
    detail::Workers(p.threads).execute([&] {
        p.cut->finish(progress);
        const detail::TileGrid grid = p.cut->grid();
        detail::TileLevels levels(
            std::move(p.cut),
            {source.bound,
             std::max(source.bound, detail::kFinestError *
                                        *std::min_element(o.spacing.begin(), o.spacing.end()))},
            p.scratch,
            [&](const detail::TileMesh& mesh, std::uint32_t number, int level) {
                return p.files.write(
                    detail::tile_path(level, number, "glb"),
                    detail::tile_glb(mesh, grid.low_of(number, level), grid.step(level), style));
            },
            progress);
        report.levels = levels.make();
        detail::TilesetPlace place{grid, p.own, style.metres, false, o.georeference, {}};
        place.extras = fmt::format("\"errors_are_from\":{}", detail::json_string(source.surface));
        if (p.layout) {
            const AnatomicalFrame frame = detail::frame_in_file(p.layout->frame, o.space, p.path);
            place.turned = frame != p.layout->frame;
            if (frame != AnatomicalFrame::unknown) {
                place.extras +=
                    fmt::format(R"(,"space":"{}")", frame == AnatomicalFrame::ras ? "RAS" : "LPS");
            }
        }
        detail::write_tileset(
            place, levels.records(),
            [&](const std::string& path, const std::string& text) { p.files.write(path, text); });
    });
    p.files.sync();
    progress.check();
    p.output.publish();
    report.files = p.files.files();
    report.bytes = p.files.bytes();
    report.scratch_bytes = p.scratch.meter()->peak();
    return report;
}

}  // namespace isonest
