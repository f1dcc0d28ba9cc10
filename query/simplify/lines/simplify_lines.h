// Fewer segments for the lines of a mesh in a plane, within a distance that is proven; out of core.
//
// The lines are chains (query/simplify/lines/line_chains.h), and each segment of the result
// replaces the part of a chain between two of its vertices. So it is enough to look at one part C
// from a to b and its segment s = ab:
// * From C to s: the distance of a point from a convex set is a convex function of the point. Along
//   each of C's segments it is largest at an end, so that the largest one of C's vertices is the
//   largest of C.
// * From s to C: let f map each point to its nearest one on s. s is convex, so f is continuous; C
// is
//   connected and f leaves a and b where they are, so f(C) is connected and holds both: it is all
//   of s. So each q on s is f(c) of a point c of C, and |q - c| is the distance of c from s.
// Both directions are within the largest distance of C's vertices from s, which is what is reported
// as the bound; all lines together are within the largest one of all parts.
//
// Chains are cut into runs, each of which gets the fewest segments that there are
// (query/simplify/lines/fewest_segments.h); then once more, across the borders of the runs; and
// where a vertex can still go, as on long straight lines, it goes. What was simplified may cross
// other lines or itself, if they are nearer to each other than twice the distance.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Heap that one thread needs.
std::uint64_t simplify_lines_heap();

/// Segments that name vertices of the mesh that was simplified.
class SimplifiedLines {
  public:
    /// `limit`: world units, > 0; both directions, between the lines of `mesh` as they are in
    /// float32 and those of the result. Vertices with another number of segments than two stay, as
    /// does the number of chains between them and of closed loops, which keep at least three
    /// segments. The same for any number of threads. `flat_axis`: the plane's normal. REQUIRES:
    /// mesh.layout().corners == 2, all vertices have the same coordinate along the flat axis, and
    /// is called within an arena of as many threads as there is memory for. Throws
    /// Error{io, cancelled}.
    SimplifiedLines(const ScratchMesh& mesh, const CornerView& segments, int flat_axis,
                    double limit, const ScratchFolder& folder, Progress& progress);

    /// The third corner repeats the second.
    [[nodiscard]] std::span<const ElementCorners> corners() const { return corners_.all(); }
    /// The largest distance of all parts from their segments, at most the limit.
    [[nodiscard]] double bound() const { return bound_; }
    /// Bytes of all temporary files, at most.

  private:
    GrowingFile<ElementCorners> corners_;
    double bound_ = 0;
};

}  // namespace isonest::detail
