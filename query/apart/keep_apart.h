// Moves vertices apart that lie in one place, so that whoever joins vertices by their positions
// has the same mesh.
//
// Where several sheets pass through a node or along an edge whose values are the isovalue, each has
// a vertex of its own there (query/march/local_mesh.cpp). What the surface faces is on another side
// for each of them: so each vertex goes that way, along the normal of its sheet, by a step that
// float32 sees. Where that is not enough, because float32 has few places for many vertices, all but
// one of those in a place go further, and at last in other directions.
//
// Source of the normal: G. Thuermer, C. A. Wuethrich, "Computing vertex normals from polygonal
// facets", Journal of Graphics Tools 3 (1998): facets weighted by their angle at the vertex.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The least step that is used, in distances between nodes: what float32 tells apart in volumes of
/// 256 nodes along an axis.
inline constexpr double kLeastApart = 0x1p-16;
inline constexpr int kMostApart = 4;  ///< steps along an axis, at most

/// The longest step. In distances between nodes; `rounding`: see coordinate_rounding(); `least`:
/// the least step that is used.
inline double step_apart(double rounding, double least) {
    return 2 * rounding > least ? 2 * rounding : least;
}
/// Whether steps are so short that it is worth while to move vertices. Else float32 has hardly more
/// places than the volume has nodes.
inline bool is_short_step(double step) {
    return step <= 0x1p-3;
}
/// Vertices on edges that are so far from the edges' ends share their places with no other vertex,
/// wherever others move. In distances between nodes.
inline double sight_apart(double rounding, double least) {
    return 8 * kMostApart * step_apart(rounding, least);
}

/// How a mesh is turned when it is written: RotatedSink.
struct Turn {
    Double3 about{};
    Directions direction = kAlongWorld;
    [[nodiscard]] std::array<float, 3> operator()(const std::array<float, 3>& p) const;
    /// Such a least step, in distances between nodes, that what is a step apart is so once it is
    /// turned, too.
    [[nodiscard]] double least_step(const Int3& nodes, const Double3& spacing) const;
};

/// A vertex and where it is.
struct PlacedVertex {
    std::array<float, 3> at{};       ///< once it is turned
    std::array<float, 3> now{};      ///< in the mesh
    std::array<float, 3> start{};    ///< in the mesh, in the beginning
    std::array<float, 3> forward{};  ///< one step along the normal; set by keep_apart()
    std::uint64_t number = 0;
};

/// Sorts by place, then by normal, then by number. How many of them are not alone in their place.
std::uint64_t sort_by_place(std::span<PlacedVertex> vertices);

/// Nothing: it is not turned.
PlacedVertex placed_vertex(std::uint64_t number, const std::array<float, 3>& at,
                           const std::optional<Turn>& turn = {});

struct ApartRange {
    bool moves = true;              ///< else vertices that are in one place are counted alone
    Double3 least_step{};           ///< world units, > 0
    std::optional<Turn> turn = {};  ///< as the vertices were placed
    /// No vertex leaves this box.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    /// A vertex that lies in one of these planes stays there if it can; NaN is no plane.
    std::array<float, 3> low_faces{};
    std::array<float, 3> high_faces{};
};

struct ApartVertices {
    std::uint64_t moved = 0;
    std::uint64_t left = 0;  ///< that share their place with another one all the same
    Double3 by{};            ///< most by which a coordinate changed, world units
};

/// Moves those of `vertices` that are not alone in their place. `positions`: of all vertices of the
/// mesh, though only those of `touched` are looked at: the triangles at vertices that are not
/// alone. `vertices`: these, and all that are within sight_apart() of them; sorted by place. They
/// tell afterwards where they are. A triangle with an area keeps one. What grows with the mesh lies
/// in temporary files in `folder`. The result depends on the mesh and `range` alone, and hardly
/// ever on the order of the mesh. Throws Error{io, cancelled}.
ApartVertices keep_apart(std::span<std::array<float, 3>> positions,
                         std::span<const ElementCorners> touched, std::span<PlacedVertex> vertices,
                         const ApartRange& range, const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
