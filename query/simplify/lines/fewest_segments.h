// The fewest segments that a chain of points can be replaced by, within a distance.
//
// Sources: H. Imai, M. Iri, "Polygonal approximations of a curve - formulations and algorithms",
// Computational Morphology (1988): the shortest path in the graph of the segments that are near
// enough to what they replace; W. S. Chan, F. Chin, "Approximation of polygonal curves with minimum
// number of line segments or minimum error", Int. J. of Computational Geometry and Applications 6
// (1996): a point is near to the segment ab if it is near to the rays from a to b and from b to a,
// so that all segments from a are found by intersecting cones, in one walk.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace isonest::detail {

using PlanePoint = std::array<double, 2>;

double square_distance_to_segment(const PlanePoint& p, const PlanePoint& a, const PlanePoint& b);

/// Thread-safety: none; keeps its memory from run to run, about n^2 bits for n points.
class FewestSegments {
  public:
    /// Places of the points that stay, ascending; the first and the last do. No point between two
    /// of them is further than `limit` from their segment. As few as there can be, but for `least`:
    /// at least as many segments, if there are as many. Where the first point is the last one, and
    /// `least` is 3, the three corners of a triangle span an area if any three do. No segment that
    /// is new has no length. REQUIRES: points.size() >= 2, least <= 3. Valid until the next call.
    std::span<const std::uint32_t> find(std::span<const PlanePoint> points, double limit,
                                        std::uint32_t least);

  private:
    /// Appends to kept_ all but the first.
    void shortest_path(std::span<const PlanePoint> points, std::uint32_t first, double limit);
    /// Splits at the points that are furthest off.
    void with_least(std::span<const PlanePoint> points, double limit, std::uint32_t least);

    std::vector<std::uint32_t> kept_;
    std::vector<std::uint64_t> near_;  ///< bit j of row i: all between are near to the ray from i
    std::vector<std::uint32_t> hops_;
    std::vector<std::uint32_t> before_;
};

}  // namespace isonest::detail
