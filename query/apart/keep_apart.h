// Separates vertices at the same place, so that joining vertices by their positions gives the same
// mesh.
//
// If several sheets pass through a node or along an edge whose values are the isovalue, each has
// its own vertex there (query/march/local_mesh.cpp). The surface faces a different side for each of
// them, so each vertex is moved to that side, along the normal of its sheet, by a step that float32
// can represent. If that is not sufficient, because float32 has few positions for many vertices,
// all but one of those at the same place are moved further, and finally in other directions.
//
// Source of the normal: G. Thuermer, C. A. Wuethrich, "Computing vertex normals from polygonal
// facets", Journal of Graphics Tools 3 (1998): facets weighted by their angle at the vertex.
#pragma once

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/mesh/part_store.h"
#include "query/mesh/scratch_mesh.h"
#include "query/mesh/weld.h"
#include "store/base/in_order.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The smallest step used, as a multiple of the distance between nodes: what float32 can
/// distinguish in volumes of 256 nodes along an axis.
inline constexpr double kMinApart = 0x1p-16;
inline constexpr int kMaxApart = 4;  ///< maximum number of steps along an axis

/// The longest step, as a multiple of the distance between nodes. `rounding`: see
/// coordinate_rounding(); `least`: the smallest step used.
inline double step_apart(double rounding, double least) {
    return 2 * rounding > least ? 2 * rounding : least;
}
/// Whether steps are short enough for moving vertices. Otherwise float32 has hardly more positions
/// than the volume has nodes.
inline bool is_short_step(double step) {
    return step <= 0x1p-3;
}
/// A vertex on an edge that is at least this far from the edge's ends never meets another vertex,
/// wherever others are moved. As a multiple of the distance between nodes.
inline double sight_apart(double rounding, double least) {
    return 8 * kMaxApart * step_apart(rounding, least);
}

/// The rotation of a mesh during output: RotatedSink.
struct Rotation {
    Double3 about{};
    Directions direction = kAlongWorld;
    [[nodiscard]] std::array<float, 3> operator()(const std::array<float, 3>& p) const;
    /// A minimum step, as a multiple of the distance between nodes, such that points one step apart
    /// are still apart after the rotation.
    [[nodiscard]] double min_step(const Int3& nodes, const LatticeSteps& steps) const;
};

/// A vertex with its position.
struct PlacedVertex {
    std::array<float, 3> at{};       ///< rotated
    std::array<float, 3> now{};      ///< in the mesh, current
    std::array<float, 3> start{};    ///< in the mesh, initial
    std::array<float, 3> forward{};  ///< one step along the normal; set by keep_apart()
    std::uint64_t number = 0;
};

/// Sorts by place, then by normal, then by number. Returns how many share their place with others.
std::uint64_t sort_by_place(std::span<PlacedVertex> vertices);

/// `rotation`: nothing if the mesh is not rotated.
PlacedVertex placed_vertex(std::uint64_t number, const std::array<float, 3>& at,
                           const std::optional<Rotation>& rotation = {});

struct ApartRange {
    bool moves = true;   ///< otherwise vertices at the same place are only counted
    Double3 min_step{};  ///< world units, > 0
    std::optional<Rotation> rotation = {};  ///< same as for the placed vertices
    /// All vertices stay in this box.
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    /// Vertices in one of these planes stay there if possible; NaN: no plane.
    std::array<float, 3> low_faces{};
    std::array<float, 3> high_faces{};
};

struct ApartVertices {
    std::uint64_t moved = 0;
    std::uint64_t left = 0;  ///< vertices that still share their place with another one
    Double3 by{};            ///< maximum change of a coordinate along each axis, world units
};

/// Moves those of `vertices` that share their place with others. `positions`: of all vertices of
/// the mesh; only those of `touched` are read. `touched`: the triangles at vertices that share
/// their place. `vertices`: these, and all within sight_apart() of them; sorted by place; updated
/// to the new positions. A triangle with an area keeps one. Data that grows with the mesh is kept
/// in temporary files in `folder`. The result depends only on the mesh and `range`, and hardly ever
/// on the order of the mesh. Throws Error{io, cancelled}.
ApartVertices keep_apart(std::span<std::array<float, 3>> positions,
                         std::span<const ElementCorners> touched, std::span<PlacedVertex> vertices,
                         const ApartRange& range, const ScratchFolder& folder, Progress& progress);

// Finds the vertices of a mesh that may be at the same place as others.

/// Stored in a temporary file.
class PlacedVertices {
  public:
    /// Those of PartStore::not_alone(), each once, with their numbers in the welded mesh. REQUIRES:
    /// PartStore::watch() was called. Throws Error{io, cancelled}.
    PlacedVertices(const PartStore& parts, const VertexNumbers& weld,
                   const std::optional<Rotation>& rotation, const ScratchFolder& folder,
                   Progress& progress);
    /// The vertices with these numbers of a mesh in memory.
    PlacedVertices(std::span<const std::array<float, 3>> positions,
                   std::span<const std::uint32_t> numbers, const ScratchFolder& folder);
    /// All vertices of a mesh.
    PlacedVertices(const ScratchMesh& mesh, const std::optional<Rotation>& rotation,
                   const ScratchFolder& folder);

    [[nodiscard]] std::span<PlacedVertex> all() const {
        return file_.as<PlacedVertex>().first(count_);
    }

  private:
    ScratchFile file_;
    std::uint64_t count_ = 0;
};

// The triangles at vertices that share their places.

/// Stored in a temporary file. Thread-safety: touches() from any thread, the rest from one.
class TouchedTriangles {
  public:
    /// For a mesh of this many vertices. `vertices`: sorted by place. Throws Error{io}.
    TouchedTriangles(std::span<const PlacedVertex> vertices, std::uint64_t mesh_vertices,
                     const ScratchFolder& folder);

    /// Whether a vertex shares its place.
    [[nodiscard]] bool touches(std::uint64_t v) const {
        return (bits_[v / kBits] >> (v % kBits) & 1U) != 0;
    }
    [[nodiscard]] bool touches(const ElementCorners& c) const {
        return touches(c[0]) || touches(c[1]) || touches(c[2]);
    }

    /// Calls make(piece), which returns a vector of triangles, from all threads of the arena, and
    /// stores the results in the order of the pieces. use(triangles) is called in that order, too.
    /// Throws what they throw, and Error{io}.
    template <class Make, class Use>
    void gather(std::uint64_t pieces, const Make& make, const Use& use) {
        in_order(
            static_cast<std::int64_t>(pieces), tbb::this_task_arena::max_concurrency() + 1,
            [&](std::int64_t i) { return make(static_cast<std::size_t>(i)); },
            [&](std::int64_t /*i*/, const auto& some) {
                use(some);
                add(some.triangles);
            });
    }
    /// Gathers the affected ones of `size` triangles; corners(t) returns the corners.
    template <class Corners>
    void gather_among(std::uint64_t size, const Corners& corners, Progress& progress) {
        constexpr std::uint64_t kPiece = std::uint64_t{1} << 16U;
        struct Some {
            std::vector<ElementCorners> triangles;
        };
        gather((size + kPiece - 1) / kPiece,
               [&](std::size_t piece) {
                   progress.check();
                   Some some;
                   for (std::uint64_t t = piece * kPiece; t < std::min(size, (piece + 1) * kPiece);
                        ++t) {
                       if (const ElementCorners c = corners(t); touches(c)) {
                           some.triangles.push_back(c);
                       }
                   }
                   return some;
               },
               [](const Some& /*some*/) {});
    }
    /// REQUIRES: everything was gathered.
    [[nodiscard]] std::span<const ElementCorners> all();

  private:
    static constexpr std::uint64_t kBits = 64;
    void add(std::span<const ElementCorners> triangles);

    ScratchFile bit_file_;
    ScratchFile triangle_file_;
    std::span<std::uint64_t> bits_;
    std::uint64_t count_ = 0;
};

// Separates the vertices of a welded mesh, in its parts.

/// The triangles of a part at some vertices, with the positions of their corners.
struct TouchedInPart {
    std::vector<ElementCorners> triangles;
    std::vector<std::array<std::array<float, 3>, 3>> at;
};
/// `touches`(number): whether a vertex is one of those, which are among PartStore::not_alone().
TouchedInPart touched_in(const PartStore& parts, const PartRecord& r, const VertexNumbers& weld,
                         const std::function<bool(std::uint64_t)>& touches);

/// Writes the new positions of the vertices to all parts: each part has its own copy of a vertex,
/// and watches it like the others. Sorts `vertices` by number.
void put_back(PartStore& parts, const VertexNumbers& weld, std::span<PlacedVertex> vertices);

/// `range`: its box is ignored; that of the parts is used. Data that grows with the mesh is kept in
/// temporary files in `folder`. REQUIRES: PartStore::watch() was called, and no triangle is without
/// area. Throws Error{io, cancelled}.
ApartVertices keep_parts_apart(PartStore& parts, const VertexNumbers& weld, ApartRange range,
                               const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
