// The cubes of a tileset, and the mesh of a tile in whole numbers.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <compare>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/simplify/patch.h"
#include "store/base/vectors.h"

namespace isonest::detail {

/// Coordinates in a tile are whole numbers from 0 to this, at any level.
inline constexpr std::int32_t kTileSteps = 1 << 15;
/// Maximum number of triangles in a tile, and in the up to eight simplified tiles that are joined
/// to one.
inline constexpr std::size_t kMaxInTile = std::size_t{1} << 15U;
inline constexpr std::size_t kMaxJoined = 4 * kMaxInTile;

/// A point in whole steps.
using Steps = std::array<std::int32_t, 3>;

/// The octree of cubes, in the volume's own axes. Level 0 is the finest; a cube at level `top`
/// contains everything. Faces of cubes are in planes of nodes, so that most triangles at full
/// resolution are not cut: cubes are boxes of as many nodes as give edges of about equal length.
struct TileGrid {
    /// Cubes along an edge of the octree have numbers of at most this many bits.
    static constexpr int kMaxTop = 8;

    Double3 origin{};  ///< low corner, in own axes, from their origin
    Double3 edge{};    ///< of a cube at level 0, world units
    int top = 0;

    /// Over the nodes `first` to `last`, with a margin of at least a node. `spacing`: of the nodes.
    /// `most`: about as many nodes along the edge of a cube, unless this needs more than kMaxTop
    /// levels.
    static TileGrid over(const Double3& spacing, const Double3& first, const Double3& last,
                         double most);
    /// The same cubes, divided once more.
    [[nodiscard]] TileGrid finer() const;

    [[nodiscard]] Double3 step(int level) const {
        Double3 steps = edge;
        for (double& step : steps) {
            step = std::ldexp(step, level) / kTileSteps;
        }
        return steps;
    }
    /// Maximum movement of a point when coordinates are rounded to steps of a level.
    [[nodiscard]] double rounding(int level) const { return length(step(level)) / 2; }
    /// In edges of cubes at level 0, from the grid's origin. `own`: in own axes.
    [[nodiscard]] Double3 in_cubes(const Double3& own) const {
        Double3 c{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            c[axis] = (own[axis] - origin[axis]) / edge[axis];
        }
        return c;
    }
    /// Low corner of a cube, from the grid's origin, world units.
    [[nodiscard]] Double3 low_of(std::uint32_t number, int level) const;
    /// Rounds a point, given in cubes, to steps of level 0. A point in a face of cubes of level k
    /// is rounded to steps of level k, so that all levels that have the face have the point.
    /// Monotone along each axis, and exact at faces.
    [[nodiscard]] std::array<std::int64_t, 3> rounded(const Double3& cubes) const;
};

/// Position of a cube on the Z-curve; x in the lowest bit. REQUIRES: below 2^10.
std::uint32_t cube_number(const std::array<std::uint32_t, 3>& cube);
std::array<std::uint32_t, 3> cube_at(std::uint32_t number);

/// A vertex of a tile.
struct TileCorner {
    std::array<std::uint16_t, 3> at{};    ///< steps from the tile's low corner
    std::array<std::int8_t, 3> normal{};  ///< 127: length 1; 0: there is no direction
    std::uint8_t padding = 0;
    float value = 0;

    bool operator==(const TileCorner&) const = default;
};

/// A triangle of a tile, for temporary files. If two corners are at the same place, it is only a
/// line, or a point.
struct TileTriangle {
    std::uint32_t block = 0;    ///< number of the cube
    std::uint32_t feature = 0;  ///< place in the features
    std::array<TileCorner, 3> corners{};
};
static_assert(sizeof(TileTriangle) == 56);

/// A mesh in memory. Coordinates are in steps of its level from the low corner of its cube, or in
/// half steps if it was joined from the level below.
struct TileMesh {
    struct Vertex {
        Steps at{};
        std::array<std::int8_t, 3> normal{};
        float value = 0;
        std::uint32_t feature = 0;
    };
    std::vector<Vertex> vertices;
    std::vector<PatchTriangle> triangles;

    /// A triangle whose corners are three places.
    [[nodiscard]] bool has_places(const PatchTriangle& t) const {
        const Steps& a = vertices[t[0]].at;
        const Steps& b = vertices[t[1]].at;
        const Steps& c = vertices[t[2]].at;
        return a != b && b != c && c != a;
    }
};

/// The mesh of a tile. Corners of a feature at the same place become one vertex. The mesh depends
/// on the set of triangles alone: they are sorted, and vertices are numbered in the order in which
/// the triangles name them.
TileMesh tile_mesh(std::span<const TileTriangle> triangles);

/// Drops triangles that have collapsed to a point or a line. However, a line that is not an edge of
/// another triangle stays, as a triangle with a third corner one step away, within the tile.
/// Returns whether there is such a line.
bool widen_lines(TileMesh& mesh);

/// The triangles again, for the next level. REQUIRES: coordinates from 0 to kTileSteps.
std::vector<TileTriangle> triangles_of(const TileMesh& mesh, std::uint32_t block);

/// A component of a normal of length 1.
inline std::int8_t normal_byte(double component) {
    constexpr double kUnit = 127;
    return static_cast<std::int8_t>(std::lround(kUnit * std::clamp(component, -1.0, 1.0)));
}

}  // namespace isonest::detail
