#include "query/tiles/cut_tiles.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "query/formats/mesh_files.h"
#include "query/mesh/cut_polygon.h"
#include "store/base/vectors.h"

namespace isonest::detail {

namespace {

/// A corner of a triangle that is cut. Coordinates are in cubes.
struct WholeCorner {
    Double3 at{};
    Double3 normal{};
    double value = 0;
};

const Double3& place_of(const WholeCorner& corner) {
    return corner.at;
}

/// As for mere positions. The attributes are linear along the edge.
WholeCorner meeting_point(const WholeCorner& below, const WholeCorner& above, std::size_t axis,
                          double plane) {
    const double t = (plane - below.at[axis]) / (above.at[axis] - below.at[axis]);
    WholeCorner p;
    p.at = isonest::detail::meeting_point(below.at, above.at, axis, plane);
    for (std::size_t i = 0; i < 3; ++i) {
        p.normal[i] = below.normal[i] + t * (above.normal[i] - below.normal[i]);
    }
    p.value = below.value + t * (above.value - below.value);
    return p;
}

/// Triangles that are held before they go to a temporary file.
constexpr std::size_t kMaxWaiting = std::size_t{1} << 13U;

/// Cuts triangles, and rounds their corners before and after.
class Cutting {
  public:
    explicit Cutting(const TileGrid& grid) : grid_(grid) {}

    /// Throws Error{invalid_argument} for a triangle beyond the cubes.
    void cut(std::array<WholeCorner, 3> corners, std::uint32_t feature) {
        moved_ = 0;
        const double end = std::ldexp(1, grid_.top);
        for (WholeCorner& corner : corners) {
            for (const double c : corner.at) {
                if (!(c >= 0 && c <= end)) {
                    throw Error(ErrorKind::invalid_argument,
                                "the mesh reaches beyond the box of its tileset");
                }
            }
            const std::array<std::int64_t, 3> at = rounded(corner.at);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                corner.at[axis] = static_cast<double>(at[axis]) / kTileSteps;
            }
        }
        // The parts do not depend on the order of the corners.
        std::rotate(corners.begin(),
                    std::min_element(
                        corners.begin(), corners.end(),
                        [](const WholeCorner& a, const WholeCorner& b) { return a.at < b.at; }),
                    corners.end());
        moved_by_corners_ = moved_;
        cut_at_planes(CutPolygon<WholeCorner>(corners[0], corners[1], corners[2]), 0, {},
                      [&](const Int3& cube, const CutPolygon<WholeCorner>& part) {
                          add(cube, part, feature);
                      });
    }
    std::vector<TileTriangle> triangles;
    std::vector<float> errors;

  private:
    /// Also takes note of the movement.
    std::array<std::int64_t, 3> rounded(const Double3& cubes) {
        const std::array<std::int64_t, 3> at = grid_.rounded(cubes);
        const Double3 step = grid_.step(0);
        Double3 by{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            by[axis] = (static_cast<double>(at[axis]) - cubes[axis] * kTileSteps) * step[axis];
        }
        moved_ = std::max(moved_, length(by));
        return at;
    }
    void add(const Int3& cube, const CutPolygon<WholeCorner>& part, std::uint32_t feature) {
        std::array<TileCorner, CutPolygon<WholeCorner>::kMax> corners{};
        moved_ = 0;
        for (std::size_t i = 0; i < part.size(); ++i) {
            corners[i] = corner_of(part[i], cube);
        }
        const std::uint32_t number =
            cube_number({static_cast<std::uint32_t>(cube.x), static_cast<std::uint32_t>(cube.y),
                         static_cast<std::uint32_t>(cube.z)});
        for (std::size_t i = 2; i < part.size(); ++i) {
            triangles.push_back({number, feature, {corners[0], corners[i - 1], corners[i]}});
            errors.push_back(float_above(moved_by_corners_ + moved_));
        }
    }
    TileCorner corner_of(const WholeCorner& whole, const Int3& cube) {
        TileCorner corner;
        const std::array<std::int64_t, 3> at = rounded(whole.at);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::int64_t first = cube[static_cast<int>(axis)] * kTileSteps;
            corner.at[axis] = static_cast<std::uint16_t>(at[axis] - first);
        }
        const std::array<float, 3> unit = unit_normal(whole.normal);
        for (std::size_t i = 0; i < 3; ++i) {
            corner.normal[i] = normal_byte(static_cast<double>(unit[i]));
        }
        corner.value = static_cast<float>(whole.value);
        return corner;
    }
    const TileGrid& grid_;
    double moved_ = 0;             ///< largest movement by rounding, world units
    double moved_by_corners_ = 0;  ///< of the whole triangle's corners
};

}  // namespace

void CutTiles::begin_errors() {
    errors_.emplace(folder_);
    errors_->map(std::uint64_t{cubes()} * sizeof(float));
}

void CutTiles::add(std::span<const TileTriangle> triangles, std::span<const float> errors) {
    const std::lock_guard lock(mutex_);
    triangles_->append(triangles);
    const auto largest = errors_->as<float>();
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        float& error = largest[triangles[i].block];
        error = std::max(error, errors[i]);
    }
}

std::uint64_t CutTiles::largest() const {
    std::uint64_t most = 0;
    for (std::uint32_t i = 0; i < cubes(); ++i) {
        most = std::max<std::uint64_t>(most, of(i).size());
    }
    return most;
}

void CutTiles::finish(Progress& progress) {
    triangles_->sort(cubes());
    while (largest() > kMaxInTile) {
        if (grid_.top == TileGrid::kMaxTop) {
            throw Error(ErrorKind::limit,
                        fmt::format("{} triangles are in one cube of an octree of {} levels, more "
                                    "than a tile may have ({}); ask for a simplified mesh",
                                    largest(), grid_.top + 1, kMaxInTile));
        }
        divide(progress);
    }
}

/// Cuts all triangles again, at the faces of cubes half as wide.
void CutTiles::divide(Progress& progress) {
    const TileGrid before = grid_;
    const std::unique_ptr<Triangles> whole = std::move(triangles_);
    const ScratchFile errors_before = std::move(*errors_);
    grid_ = grid_.finer();
    triangles_ = std::make_unique<Triangles>(folder_);
    begin_errors();
    const auto largest = errors_->as<float>();
    const auto hand_over = [&](Cutting& some, float before_cut) {
        triangles_->append(some.triangles);
        for (std::size_t i = 0; i < some.triangles.size(); ++i) {
            float& error = largest[some.triangles[i].block];
            error = std::max(error, float_above(static_cast<double>(some.errors[i]) +
                                                static_cast<double>(before_cut)));
        }
        some.triangles.clear();
        some.errors.clear();
    };
    for (std::uint32_t cube = 0; cube < std::uint32_t{1} << (3 * before.top); ++cube) {
        progress.check();
        Cutting cutting(grid_);
        const std::array<std::uint32_t, 3> first = cube_at(cube);
        for (const TileTriangle& t : whole->of(cube)) {
            std::array<WholeCorner, 3> corners;
            for (std::size_t k = 0; k < 3; ++k) {
                for (std::size_t i = 0; i < 3; ++i) {
                    corners[k].at[i] =
                        2 * (first.at(i) + static_cast<double>(t.corners[k].at[i]) / kTileSteps);
                    corners[k].normal[i] = t.corners[k].normal[i];
                }
                corners[k].value = static_cast<double>(t.corners[k].value);
            }
            cutting.cut(corners, t.feature);
            if (cutting.triangles.size() >= kMaxWaiting) {
                hand_over(cutting, errors_before.as<const float>()[cube]);
            }
        }
        hand_over(cutting, errors_before.as<const float>()[cube]);
    }
    triangles_->sort(cubes());
}

void TileCutter::prepare(const MeshLayout& layout,
                         std::span<const std::filesystem::path> /*inputs*/) {
    if (layout.corners != 3) {
        throw Error(ErrorKind::invalid_argument, "3D Tiles have triangles, no lines");
    }
    if (layout.has_sides) {
        throw Error(ErrorKind::invalid_argument,
                    "3D Tiles do not store the labels on both sides of a triangle");
    }
    const VertexAttribute* const kept = main_scalar(layout);
    for (const VertexAttribute& attribute : layout.attributes) {
        if (!is_of_extraction(attribute) && &attribute != kept) {
            throw Error(
                ErrorKind::invalid_argument,
                fmt::format(
                    "the vertices of 3D Tiles have only one number each, so {} cannot be stored",
                    attribute.name),
                {{RemedyKind::other_format, ".ply, .vtp, .vtkhdf, .glb"}});
        }
    }
}

void TileCutter::begin(const MeshLayout& layout) {
    prepare(layout, {});
    layout_ = layout;
    normal_ = layout_.find("normal");
    value_ = main_scalar(layout_);
    isovalue_ = layout_.find("isovalue");
    sums_ = normal_ == nullptr;
    if (sums_) {
        normals_.emplace(folder_);
        normals_->map(layout.vertices * sizeof(std::array<float, 3>));
    }
}

bool TileCutter::again() {
    const bool more = sums_;
    sums_ = false;
    return more;
}

std::uint32_t TileCutter::feature_of(const ElementBatch& batch, std::size_t vertex) const {
    if (isovalue_ == nullptr) {
        return feature_;
    }
    const double isovalue = batch.nearby.number(vertex, *isovalue_);
    // float32 may round it.
    const auto nearest = std::min_element(
        isovalues_.begin(), isovalues_.end(),
        [&](double a, double b) { return std::fabs(a - isovalue) < std::fabs(b - isovalue); });
    return nearest == isovalues_.end() ? feature_
                                       : static_cast<std::uint32_t>(nearest - isovalues_.begin());
}

void TileCutter::sum_normals(const ElementBatch& batch) {
    const auto sums = normals_->as<std::array<float, 3>>();
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        std::array<Double3, 3> p{};
        for (std::size_t k = 0; k < 3; ++k) {
            const auto& at = batch.nearby.positions[batch.nearby_corners[i][k]];
            p[k] = {static_cast<double>(at[0]), static_cast<double>(at[1]),
                    static_cast<double>(at[2])};
        }
        const Double3 normal = cross({p[1][0] - p[0][0], p[1][1] - p[0][1], p[1][2] - p[0][2]},
                                     {p[2][0] - p[0][0], p[2][1] - p[0][1], p[2][2] - p[0][2]});
        for (const std::uint64_t v : batch.corners[i]) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                sums[v][axis] += static_cast<float>(normal[axis]);
            }
        }
    }
}

void TileCutter::add_elements(const ElementBatch& batch) {
    if (sums_) {
        sum_normals(batch);
        return;
    }
    Cutting cutting(grid_);
    const auto hand_over = [&] {
        tiles_.add(cutting.triangles, cutting.errors);
        cutting.triangles.clear();
        cutting.errors.clear();
    };
    for (std::size_t i = 0; i < batch.nearby_corners.size(); ++i) {
        std::array<WholeCorner, 3> corners;
        for (std::size_t k = 0; k < 3; ++k) {
            const std::uint32_t v = batch.nearby_corners[i][k];
            const auto& p = batch.nearby.positions[v];
            corners[k].at = grid_.in_cubes(own_.place(
                {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])}));
            for (int axis = 0; axis < 3; ++axis) {
                corners[k].normal[static_cast<std::size_t>(axis)] =
                    normal_ != nullptr
                        ? batch.nearby.number(v, *normal_, axis)
                        : static_cast<double>(
                              normals_->as<const std::array<float, 3>>()[batch.corners[i][k]]
                                                                        [static_cast<std::size_t>(
                                                                            axis)]);
            }
            const auto unit = unit_normal(unrotated(own_.axes, corners[k].normal));
            for (std::size_t axis = 0; axis < 3; ++axis) {
                corners[k].normal[axis] = static_cast<double>(unit[axis]);
            }
            corners[k].value = value_ != nullptr ? batch.nearby.number(v, *value_) : 0;
        }
        cutting.cut(corners, feature_of(batch, batch.nearby_corners[i][0]));
        if (cutting.triangles.size() >= kMaxWaiting) {
            hand_over();
        }
    }
    hand_over();
}

}  // namespace isonest::detail
