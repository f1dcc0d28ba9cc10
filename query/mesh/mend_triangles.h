// Repairs the triangles of a mesh that have no area because float32 rounds their corners to one
// place or onto a line.
//
// Steps that do not change the geometry come first. An edge between two vertices at the same place
// is collapsed. If three corners are on a line, the longest side is flipped to the opposite corner
// of the neighbour, so that the middle corner becomes a vertex of the neighbour; if that side is a
// border, the triangle is removed. Both are done only if the topology is preserved
// (query/mesh/vertex_stars.h). If neither is possible, a vertex is moved by units in the last place
// (nudged()). Each step leaves fewer triangles without area, or fewer of them that are points, so
// the process terminates.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Moves a vertex by the smallest amounts that float32 can represent, so that the triangles around
// it have an area.

/// 0 for a triangle with an area, 1 for one that is a segment, 2 for a point.
int missing_dimensions(const std::array<float, 3>& a, const std::array<float, 3>& b,
                       const std::array<float, 3>& c);

/// How a vertex may move relative to the box around the mesh.
enum class NudgeFreedom : std::uint8_t {
    stay_on_faces,  ///< vertices on a face stay in it; nothing leaves the box
    stay_in_box,
    anywhere
};

struct NudgeRange {
    /// Steps along an axis are units in the last place of the coordinate, but at least this; world
    /// units.
    Double3 min_step{};
    /// The box.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
};

/// A new position for the vertex, with its effect.
struct Nudge {
    std::array<float, 3> to{};
    int mended = 0;  ///< dimensions that the triangles gain, > 0
    int turned = 0;  ///< triangles that face against their former surroundings
    /// Square of the smallest height among the triangles around that then have an area.
    double square_height = 0;
};

/// The two corners of a triangle that follow the vertex.
using OppositeSide = std::array<std::array<float, 3>, 2>;

/// The best position exactly `steps` steps away along at least one axis and at most that along the
/// others. Criteria in this order: fewest triangles turned, most dimensions gained, largest minimum
/// height, first in a fixed order. Nothing if no position gains without a loss elsewhere. `around`:
/// the triangles around the vertex.
std::optional<Nudge> nudged(const std::array<float, 3>& vertex,
                            std::span<const OppositeSide> around, const NudgeRange& range,
                            int steps, NudgeFreedom freedom);

/// The smallest step used, as a multiple of the distance between nodes: at most the rounding of
/// float32 coordinates in volumes of 16 nodes along an axis.
inline constexpr double kMinNudge = 0x1p-20;

struct MendedTriangles {
    std::uint64_t found = 0;  ///< triangles without area
    std::uint64_t left = 0;
    std::uint64_t moved_vertices = 0;
    Double3 moved{};  ///< maximum change of a coordinate along each axis, world units
};

/// Repairs `mesh`; remaining triangles and vertices keep their order. `min_step`: minimum movement
/// of a vertex along an axis; world units, >= 0. Data that grows with the mesh is kept in temporary
/// files in `folder`. The result depends only on the mesh and `min_step`. REQUIRES: triangles.
/// Throws Error{io, cancelled}.
MendedTriangles mend_triangles(ScratchMesh& mesh, const Double3& min_step,
                               const ScratchFolder& folder, Progress& progress);

/// The same for a mesh in memory. Triangles are not removed: those to be deleted get kNoTriangle
/// instead of a corner, and vertices used by no other triangle stay. `moved_vertices` receives the
/// vertices that were moved. `lo`, `hi`: the box of the whole mesh, of which this may be a part:
/// only triangles that share a corner with one without area matter. If few triangles are to be
/// repaired, all threads of the arena search for them.
inline constexpr std::uint32_t kNoTriangle = 0xFFFFFFFFU;
MendedTriangles mend_triangles(std::span<std::array<float, 3>> positions,
                               std::span<std::array<std::uint32_t, 3>> triangles,
                               const std::array<float, 3>& lo, const std::array<float, 3>& hi,
                               const Double3& min_step, std::vector<std::uint32_t>& moved_vertices,
                               const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
