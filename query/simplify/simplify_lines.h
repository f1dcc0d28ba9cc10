// Simplifies the lines of a mesh in a plane within a proven distance; out of core.
//
// The lines are chains (LineChains), and each segment of the result replaces the part of a chain
// between two of its vertices. So it is sufficient to consider one part C from a to b and its
// segment s = ab:
// * From C to s: the distance of a point from a convex set is a convex function of the point. Along
//   each segment of C it is largest at an end, so its maximum over C is at one of C's vertices.
// * From s to C: let f map each point to its nearest point on s. s is convex, so f is continuous. C
//   is connected and f maps a and b to themselves, so f(C) is connected and contains both: it is
//   all of s. So each q on s is f(c) for a point c of C, and |q - c| is the distance of c from s.
// Both directions are bounded by the largest distance of C's vertices from s, which is reported as
// the bound. For all lines together the bound is the maximum over all parts.
//
// Chains are divided into runs; each is replaced by the minimum number of segments
// (FewestSegments). This is repeated across the borders of the runs; then vertices that are still
// unnecessary, as on long straight lines, are removed. The result may cross other lines or itself
// if they are nearer to each other than twice the distance.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_files.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The minimum number of segments that can replace a chain of points within a distance.
//
// Sources: H. Imai, M. Iri, "Polygonal approximations of a curve - formulations and algorithms",
// Computational Morphology (1988): the shortest path in the graph of the segments that are close
// enough to what they replace; W. S. Chan, F. Chin, "Approximation of polygonal curves with minimum
// number of line segments or minimum error", Int. J. of Computational Geometry and Applications 6
// (1996): a point is near the segment ab if it is near the rays from a to b and from b to a, so all
// segments from a are found in one walk, by intersecting cones.

using PlanePoint = std::array<double, 2>;

double square_distance_to_segment(const PlanePoint& p, const PlanePoint& a, const PlanePoint& b);

/// Thread-safety: none. Keeps its memory from run to run, about n^2 bits for n points.
class FewestSegments {
  public:
    /// Returns the indices of the points that are kept, ascending, including the first and the
    /// last. No point between two of them is further than `limit` from their segment. The number of
    /// segments is minimal, but at least `least` if there are that many. If the first point equals
    /// the last and `least` is 3, the three corners of a triangle span an area if any three points
    /// do. No new segment has length 0. REQUIRES: points.size() >= 2, least <= 3. Valid until the
    /// next call.
    std::span<const std::uint32_t> find(std::span<const PlanePoint> points, double limit,
                                        std::uint32_t least);

  private:
    /// Appends all points except the first to kept_.
    void shortest_path(std::span<const PlanePoint> points, std::uint32_t first, double limit);
    /// Splits at the points with the largest distance.
    void with_min(std::span<const PlanePoint> points, double limit, std::uint32_t least);

    std::vector<std::uint32_t> kept_;
    std::vector<std::uint64_t> near_;  ///< bit j of row i: all points between are near the ray from
                                       ///< i
    std::vector<std::uint32_t> hops_;
    std::vector<std::uint32_t> before_;
};

// The lines of a mesh as chains: vertices in the order in which segments connect them.

/// A part between two ends (an end is a vertex whose number of segments is not two), or a closed
/// loop.
struct Chain {
    std::uint64_t first = 0;     ///< index of its first vertex in LineChains::vertices()
    std::uint64_t vertices = 0;  ///< each vertex once; the last vertex of a loop is connected to
                                 ///< the first
    std::uint32_t closed = 0;    ///< a loop
    /// Minimum number of segments that preserves the topology: 3 for a loop, also for one that
    /// starts and ends at the same vertex with other segments; 2 if neither end is the end of all
    /// lines there, because another chain may connect the same two ends. At most the number of
    /// segments.
    std::uint32_t least = 1;

    [[nodiscard]] std::uint64_t segments() const { return vertices - 1 + closed; }
    /// Index of vertex i; for a loop, i may be up to twice the number of vertices.
    [[nodiscard]] std::uint64_t place(std::uint64_t i) const {
        return first + (i < vertices ? i : i - vertices);
    }
};

/// Every segment of the mesh belongs to exactly one chain. The order depends only on the mesh. Data
/// that grows with the mesh is kept in temporary files. Thread-safety: constant once it is made.
class LineChains {
  public:
    /// `segments`: of vertices of `mesh`. REQUIRES: mesh.layout().corners == 2. Throws Error{io,
    /// cancelled}.
    LineChains(const ScratchMesh& mesh, const CornerView& segments, const ScratchFolder& folder,
               Progress& progress);

    [[nodiscard]] std::span<const Chain> chains() const { return chains_.all(); }
    /// The vertices of all chains, one after another: vertex numbers of the mesh.
    [[nodiscard]] std::span<const std::uint64_t> vertices() const { return vertices_.all(); }
    /// Bytes of its temporary files, at most.

  private:
    GrowingFile<Chain> chains_;
    GrowingFile<std::uint64_t> vertices_;
};

/// Heap that one thread needs.
std::uint64_t simplify_lines_heap();

/// Segments between vertices of the mesh that was simplified.
class SimplifiedLines {
  public:
    /// `limit`: world units, > 0; applies to both directions, between the float32 lines of `mesh`
    /// and those of the result. Vertices whose number of segments is not two are kept, as are the
    /// number of chains between them and the number of closed loops, which keep at least three
    /// segments. The result does not depend on the number of threads. `flat_axis`: the plane's
    /// normal. REQUIRES: mesh.layout().corners == 2, all vertices have the same coordinate along
    /// the flat axis, called within an arena with as many threads as there is memory for. Throws
    /// Error{io, cancelled}.
    SimplifiedLines(const ScratchMesh& mesh, const CornerView& segments, int flat_axis,
                    double limit, const ScratchFolder& folder, Progress& progress);

    /// The third corner repeats the second.
    [[nodiscard]] std::span<const ElementCorners> corners() const { return corners_.all(); }
    /// The largest distance between a part and its segment, at most the limit.
    [[nodiscard]] double bound() const { return bound_; }
    /// Bytes of all temporary files, at most.

  private:
    GrowingFile<ElementCorners> corners_;
    double bound_ = 0;
};

}  // namespace isonest::detail
