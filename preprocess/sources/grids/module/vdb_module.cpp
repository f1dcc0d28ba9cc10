// OpenVDB files, in a separate module: the library pulls in others that start threads as soon as
// they are loaded (Debian's log4cplus), which would cost programs that never read such a file.

#include "preprocess/sources/grids/module/vdb_module.h"

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <fstream>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kOldestVersion = 222;
constexpr std::uint32_t kMaxGrids = 1000000;

/// Numbers and lengths of an OpenVDB file, little-endian; 0 beyond its end.
class VdbBytes {
  public:
    explicit VdbBytes(const std::filesystem::path& path) : file_(path, std::ios::binary) {}
    [[nodiscard]] bool good() const { return file_.good(); }
    std::uint64_t number(std::size_t bytes) {
        std::uint64_t result = 0;
        for (std::size_t i = 0; i < bytes; ++i) {
            const int next = file_.get();
            result |= static_cast<std::uint64_t>(next < 0 ? 0 : next) << (8 * i);
        }
        return result;
    }
    void skip(std::uint64_t bytes) {
        file_.seekg(static_cast<std::streamoff>(bytes), std::ios::cur);
    }
    void skip_text() { skip(number(4)); }
    void go_to(std::uint64_t at) { file_.seekg(static_cast<std::streamoff>(at)); }

  private:
    std::ifstream file_;
};

}  // namespace

std::uint64_t end_of_vdb_grids(const std::filesystem::path& path) {
    constexpr std::uint64_t kMagic = 8;
    constexpr std::uint64_t kLibraryVersion = 8;
    constexpr std::uint64_t kUuid = 36;
    VdbBytes file(path);
    file.skip(kMagic);
    if (file.number(4) < kOldestVersion) {
        return 0;
    }
    file.skip(kLibraryVersion);
    const bool has_offsets = file.number(1) != 0;
    file.skip(kUuid);
    for (std::uint64_t metadata = file.number(4); metadata > 0 && file.good(); --metadata) {
        file.skip_text();  // its name
        file.skip_text();  // its type
        file.skip_text();  // its value, also preceded by a length
    }
    const std::uint64_t grids = file.number(4);
    std::uint64_t end = 0;
    for (std::uint64_t i = 0; i < grids && i < kMaxGrids && has_offsets && file.good(); ++i) {
        file.skip_text();  // its name
        file.skip_text();  // its type
        file.skip_text();  // the grid whose tree it shares
        file.skip(2 * 8);  // offsets of the grid and its blocks
        const std::uint64_t at = file.number(8);
        end = std::max(end, at);
        file.go_to(at);
    }
    return end;
}

namespace {

/// The box of a grid's active values; elsewhere the background value.
template <class Grid>
class VdbSource : public VolumeSource {
  public:
    VdbSource(typename Grid::Ptr grid, const openvdb::CoordBBox& box, const Placement& place,
              std::filesystem::path path, std::string grid_name)
        : grid_(std::move(grid)),
          box_(box),
          place_(place),
          path_(std::move(path)),
          grid_name_(std::move(grid_name)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        const openvdb::Coord size = box_.dim();
        return {{size.x(), size.y(), size.z()},
                std::is_same_v<typename Grid::ValueType, float> ? ValueType::f32 : ValueType::f64,
                place_.spacing,
                place_.origin,
                path_.string() + ":" + grid_name_,
                place_.direction};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {path_}; }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}grid {}\n", identity_of({path_}), grid_name_);
    }
    [[nodiscard]] std::uint64_t heap() const override { return (1U << 20U) + grid_->memUsage(); }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        using Value = typename Grid::ValueType;
        const auto low = [&](std::int64_t y, std::int64_t z) {
            return box_.min() + openvdb::Coord(0, static_cast<int>(y), static_cast<int>(z));
        };
        const openvdb::CoordBBox part(
            low(y0, z0), low(y0 + ny - 1, z0 + nz - 1) + openvdb::Coord(box_.dim().x() - 1, 0, 0));
        openvdb::tools::Dense<Value, openvdb::tools::LayoutXYZ> dense(
            part, reinterpret_cast<Value*>(dst));
        // Single-threaded: the number of threads is up to the caller.
        openvdb::tools::copyToDense(*grid_, dense, true);
    }

  private:
    typename Grid::Ptr grid_;
    openvdb::CoordBBox box_;
    Placement place_;
    std::filesystem::path path_;
    std::string grid_name_;  ///< unique, also if several grids in the file have the same name
};

/// A grid of a file. Grids with the same name are distinguished as "density[1]".
struct NamedGrid {
    std::string name;   ///< unique
    std::string given;  ///< may be shared by several grids
    std::string type;
};

std::vector<NamedGrid> grids_of(openvdb::io::File& file) {
    std::vector<NamedGrid> grids;
    for (auto it = file.beginName(); it != file.endName(); ++it) {
        const openvdb::GridBase::Ptr grid = file.readGridMetadata(it.gridName());
        grids.push_back({it.gridName(), grid->getName(), grid->valueType()});
    }
    return grids;
}

std::string list_of(const std::vector<NamedGrid>& grids) {
    std::string text;
    for (const NamedGrid& grid : grids) {
        text += fmt::format("\n  {} ({})", grid.name, grid.type);
    }
    return text.empty() ? " nothing" : text;
}

/// The named grid, or the only one that can be read.
std::string choose_grid(const std::vector<NamedGrid>& grids, const std::string& wanted,
                        const std::string& name) {
    std::vector<std::string> fitting;
    for (const NamedGrid& grid : grids) {
        const bool is_read = grid.type == "float" || grid.type == "double";
        if (is_read && !wanted.empty() && grid.name == wanted) {
            return grid.name;
        }
        if (is_read && (wanted.empty() || grid.given == wanted)) {
            fitting.push_back(grid.name);
        }
    }
    if (fitting.size() == 1) {
        return fitting[0];
    }
    if (fitting.empty() && !wanted.empty()) {
        throw Error(ErrorKind::not_found, {name},
                    fmt::format("there is no grid {} of floating point numbers; the file has:{}",
                                wanted, list_of(grids)),
                    {{RemedyKind::choose_dataset}});
    }
    throw Error(fitting.empty() ? ErrorKind::unsupported : ErrorKind::invalid_argument, {name},
                fmt::format("there are {} grids of floating point numbers; the file has:{}",
                            fitting.size(), list_of(grids)),
                {{RemedyKind::choose_dataset}});
}

Double3 to_double3(const openvdb::Vec3d& v) {
    return {v.x(), v.y(), v.z()};
}

template <class Grid>
std::unique_ptr<VolumeSource> open_grid(const openvdb::GridBase::Ptr& base,
                                        const VolumeInput& input, const SourceOptions& options,
                                        const std::string& grid_name) {
    const std::string name = input.path().string() + ":" + grid_name;
    const typename Grid::Ptr grid = openvdb::gridPtrCast<Grid>(base);
    const openvdb::CoordBBox box = grid->evalActiveVoxelBoundingBox();
    if (box.empty()) {
        throw Error(ErrorKind::unsupported, {name}, "the grid has no active values");
    }
    if (grid->memUsage() > options.max_heap) {
        throw Error(ErrorKind::limit, {name},
                    fmt::format("the grid needs {} bytes of memory", grid->memUsage()),
                    {{RemedyKind::more_memory}});
    }
    const openvdb::math::Transform& transform = grid->transform();
    if (!transform.isLinear()) {
        throw Error(ErrorKind::unsupported, {name},
                    "a transform with perspective is not supported; resample the grid");
    }
    const openvdb::Coord size = box.dim();
    const openvdb::Vec3d first = transform.indexToWorld(box.min());
    std::array<Double3, 3> steps{};
    for (int a = 0; a < 3; ++a) {
        openvdb::Coord next = box.min();
        next[a] += 1;
        steps.at(static_cast<std::size_t>(a)) = to_double3(transform.indexToWorld(next) - first);
    }
    const Int3 nodes{size.x(), size.y(), size.z()};
    Placement place;
    std::string lost;
    if (options.spacing) {
        place.origin = to_double3(first);
        lost = lost_by_own_spacing(nodes, steps);
    } else {
        place = place_in_world(nodes, steps, to_double3(first), name);
    }
    auto source =
        mirrored(std::make_unique<VdbSource<Grid>>(grid, box, place, input.path(), grid_name),
                 place.backward);
    return lost.empty() ? std::move(source) : with_notes(std::move(source), {lost});
}

std::unique_ptr<VolumeSource> open_vdb(const VolumeInput& input, const SourceOptions& options) {
    const std::string path = input.path().string();
    try {
        const std::uint64_t size = std::filesystem::file_size(input.path());
        if (const std::uint64_t end = end_of_vdb_grids(input.path()); end > size) {
            throw Error(
                ErrorKind::corrupt, {path},
                fmt::format("the grids end at byte {}, but the file has {} bytes; it was cut short",
                            end, size),
                {{RemedyKind::good_copy}});
        }
        openvdb::initialize();
        openvdb::io::File file(path);
        file.open(false);
        const std::string chosen = choose_grid(grids_of(file), options.dataset, path);
        const openvdb::GridBase::Ptr grid = file.readGrid(chosen);
        return grid->valueType() == "float"
                   ? open_grid<openvdb::FloatGrid>(grid, input, options, chosen)
                   : open_grid<openvdb::DoubleGrid>(grid, input, options, chosen);
    } catch (const Error&) {
        throw;
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& e) {
        throw Error(ErrorKind::corrupt, {path}, e.what(), {{RemedyKind::good_copy}});
    }
}

}  // namespace
}  // namespace isonest::detail

isonest::VolumeSource* isonest_open_vdb(const isonest::detail::VolumeInput& input,
                                        const isonest::SourceOptions& options) {
    return isonest::detail::open_vdb(input, options).release();
}
