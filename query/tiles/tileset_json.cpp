// The format: OGC 22-025r4, "3D Tiles Specification 1.1" (2023).
#include "query/tiles/tileset_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "store/base/vectors.h"

namespace isonest::detail {

std::string tile_path(int level, std::uint32_t number, const char* extension) {
    const auto cube = cube_at(number);
    return fmt::format("tiles/{}/{}_{}_{}.{}", level, cube[0], cube[1], cube[2], extension);
}

Matrix4 earth_matrix(const Georeference& place) {
    // Source of the ellipsoid: NIMA TR8350.2, "Department of Defense World Geodetic System 1984".
    constexpr double kRadius = 6378137.0;
    constexpr double kFlattening = 1 / 298.257223563;
    constexpr double kSquare = kFlattening * (2 - kFlattening);  // of the eccentricity
    constexpr double kDegree = std::numbers::pi / 180;
    const double sin_lon = std::sin(place.longitude * kDegree);
    const double cos_lon = std::cos(place.longitude * kDegree);
    const double sin_lat = std::sin(place.latitude * kDegree);
    const double cos_lat = std::cos(place.latitude * kDegree);
    const double normal = kRadius / std::sqrt(1 - kSquare * sin_lat * sin_lat);
    return {-sin_lon,
            cos_lon,
            0,
            0,
            -sin_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lat,
            0,
            cos_lat * cos_lon,
            cos_lat * sin_lon,
            sin_lat,
            0,
            (normal + place.height) * cos_lat * cos_lon,
            (normal + place.height) * cos_lat * sin_lon,
            (normal * (1 - kSquare) + place.height) * sin_lat,
            1};
}

namespace {

Matrix4 product(const Matrix4& a, const Matrix4& b) {
    Matrix4 c{};
    for (std::size_t column = 0; column < 4; ++column) {
        for (std::size_t row = 0; row < 4; ++row) {
            for (std::size_t i = 0; i < 4; ++i) {
                c[4 * column + row] += a[4 * i + row] * b[4 * column + i];
            }
        }
    }
    return c;
}

class TilesetWriter {
  public:
    /// Levels of the octree that are listed in one file.
    static constexpr int kInOneFile = 4;

    TilesetWriter(const TilesetPlace& place, std::span<const std::unique_ptr<TileRecords>> levels,
                  const std::function<void(const std::string&, const std::string&)>& write)
        : place_(place), levels_(levels), write_(write) {}

    void write() {
        const int root = static_cast<int>(levels_.size()) - 1;
        std::string tile = R"({"boundingVolume":{"box":[0,0,0,1,0,0,0,1,0,0,0,1]},)"
                           R"("geometricError":0,"refine":"REPLACE"})";
        double error = 0;
        if (root >= 0 && !levels_[static_cast<std::size_t>(root)]->all().empty()) {
            const TileRecord& record = levels_[static_cast<std::size_t>(root)]->all().front();
            tile = tile_text(root, record, "", fmt::format(R"(,"transform":[{}])", transform()));
            error = std::max(length(size_of(record)) * place_.metres, error_of(root, record));
        }
        write_("tileset.json",
               fmt::format(R"({{"asset":{{"version":"1.1","generator":"isonest","extras":{{{}}}}},)"
                           R"("geometricError":{},"root":{}}})",
                           place_.extras, error, tile) +
                   "\n");
    }

  private:
    static Double3 size_of(const TileRecord& r) {
        return {r.high[0] - r.low[0], r.high[1] - r.low[1], r.high[2] - r.low[2]};
    }
    [[nodiscard]] std::string transform() const {
        // From the grid's low corner, in own axes, to the world.
        const Double3 corner = rotated(place_.own.axes, place_.grid.origin);
        Matrix4 m{};
        for (std::size_t row = 0; row < 3; ++row) {
            const double sign = place_.turned && row < 2 ? -1 : 1;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                m[4 * axis + row] = 0 + sign * place_.own.axes[axis][row];
            }
            m[12 + row] = 0 + sign * (place_.own.origin[row] + corner[row]) * place_.metres;
        }
        m[15] = 1;
        if (place_.georeference) {
            m = product(earth_matrix(*place_.georeference), m);
        }
        std::string text;
        for (const double x : m) {
            text += fmt::format("{}{}", text.empty() ? "" : ",", x);
        }
        return text;
    }
    [[nodiscard]] std::string box_text(const TileRecord& r) const {
        // No corner leaves the box by rounding.
        constexpr double kWider = 1 + 1e-6;
        Double3 middle{};
        Double3 half{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            middle[axis] = (r.low[axis] + r.high[axis]) / 2 * place_.metres;
            half[axis] = (r.high[axis] - r.low[axis]) / 2 * place_.metres * kWider +
                         place_.grid.step(0)[axis] * place_.metres;
        }
        return fmt::format("{},{},{},{},0,0,0,{},0,0,0,{}", middle[0], middle[1], middle[2],
                           half[0], half[1], half[2]);
    }
    /// The error of a tile; of one without a mesh, its size, so that clients load its parts.
    [[nodiscard]] double error_of(int level, const TileRecord& r) const {
        return (r.triangles > 0 ? r.error : std::ldexp(length(place_.grid.edge), level)) *
               place_.metres;
    }
    /// The number of triangles, so that viewers know it before they load a tile.
    static std::string extras_of(const TileRecord& r) {
        return fmt::format(R"(,"extras":{{"triangles":{}}})", r.triangles);
    }
    [[nodiscard]] std::span<const TileRecord> children_of(int level, const TileRecord& r) const {
        if (level == 0) {
            return {};
        }
        const std::span<const TileRecord> all = levels_[static_cast<std::size_t>(level) - 1]->all();
        const auto before = [](const TileRecord& a, std::uint32_t number) {
            return a.number < number;
        };
        const auto first = std::lower_bound(all.begin(), all.end(), 8 * r.number, before);
        const auto last = std::lower_bound(first, all.end(), 8 * r.number + 8, before);
        return all.subspan(static_cast<std::size_t>(first - all.begin()),
                           static_cast<std::size_t>(last - first));
    }
    /// `up`: the way from the list's folder to the tileset's. `more`: further members.
    std::string tile_text(int level, const TileRecord& r, const std::string& up,
                          const std::string& more) {
        std::string text = fmt::format(R"({{"boundingVolume":{{"box":[{}]}},"geometricError":{},)"
                                       R"("refine":"REPLACE"{})",
                                       box_text(r), error_of(level, r), more);
        if (r.triangles > 0) {
            text += fmt::format(R"(,"content":{{"uri":"{}{}"}})", up,
                                tile_path(level, r.number, "glb"));
        }
        text += extras_of(r);
        const std::span<const TileRecord> children = children_of(level, r);
        std::string list;
        for (const TileRecord& child : children) {
            list += list.empty() ? "" : ",";
            list += child_text(level - 1, child, up);
        }
        if (!children.empty()) {
            text += fmt::format(R"(,"children":[{}])", list);
        }
        return text + "}";
    }
    std::string child_text(int level, const TileRecord& r, const std::string& up) {
        const int root = static_cast<int>(levels_.size()) - 1;
        if ((root - level) % kInOneFile != 0 || level == 0) {
            return tile_text(level, r, up, "");
        }
        // From tiles/LEVEL/ back to the tileset's folder.
        const std::string path = tile_path(level, r.number, "json");
        write_(path, fmt::format(R"({{"asset":{{"version":"1.1","generator":"isonest"}},)"
                                 R"("geometricError":{},"root":{}}})",
                                 error_of(level, r), tile_text(level, r, "../../", "")) +
                         "\n");
        return fmt::format(R"({{"boundingVolume":{{"box":[{}]}},"geometricError":{},)"
                           R"("refine":"REPLACE","content":{{"uri":"{}{}"}}{}}})",
                           box_text(r), error_of(level, r), up, path, extras_of(r));
    }

    const TilesetPlace& place_;
    std::span<const std::unique_ptr<TileRecords>> levels_;
    const std::function<void(const std::string&, const std::string&)>& write_;
};

}  // namespace

void write_tileset(
    const TilesetPlace& place, std::span<const std::unique_ptr<TileRecords>> levels,
    const std::function<void(const std::string& path, const std::string& text)>& write) {
    TilesetWriter(place, levels, write).write();
}

}  // namespace isonest::detail
