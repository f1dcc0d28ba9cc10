// Whether two surfaces of triangles stay within a distance of each other, proven.
//
// The distance from a convex set is a convex function, so over a triangle it is largest at a
// corner: if one triangle of the other surface is within the limit of all three corners, it is of
// every point between them. Where no single one is, the triangle is cut; and a piece of radius r
// around a point at distance d is no further than d + r. Both are bounds, not samples. Source of
// the branch and bound: M. Guthe, P. Borodin, R. Klein, "Fast and accurate Hausdorff distance
// calculation between meshes", Journal of WSCG 13 (2005).
#pragma once

#include <cstdlib>
#include <vector>

#include "query/simplify/proof/triangle_tree.h"

namespace isonest::detail {

/// Distances from one surface. Not thread-safe.
class SurfaceDistance {
  public:
    /// `limit`: > 0.
    SurfaceDistance(const TriangleTree& surface, double limit)
        : surface_(surface),
          limit_(limit),
          square_limit_(limit * limit),
          size_(kReach * surface.typical_edge()) {}

    /// Whether every point of `t` is within the limit of the surface. REQUIRES: nothing of
    /// triangles much larger than the surface's.
    [[nodiscard]] bool serves(const Triangle& t);
    /// The triangles that do, after serves() was true: one, if one alone does.
    [[nodiscard]] const std::vector<std::uint32_t>& servers() const { return servers_; }
    /// The same question for a triangle that may be much larger than those of the surface.
    [[nodiscard]] bool covers(const Triangle& t);
    /// Where, after one of the two was false.
    [[nodiscard]] const Double3& miss() const { return miss_; }
    /// After one of the two was true: no point of `t` is further away than this; at most the limit.
    [[nodiscard]] double largest() const { return largest_; }

  private:
    bool serve(const Triangle& t, int depth);
    bool served_by(const Triangle& t, std::uint32_t server);
    bool cover(const Triangle& t, int depth);
    bool is_near_recent(const Double3& centre, double radius);
    void remember(std::uint32_t triangle, std::size_t place);

    const TriangleTree& surface_;
    double limit_;
    /// In edges of the surface: pieces of a larger radius are cut before anything else is tried.
    static inline const double kReach = std::getenv("ISO_REACH") ? atof(std::getenv("ISO_REACH")) : 0.8;
    double square_limit_;
    double size_;
    std::vector<std::uint32_t> servers_;
    std::vector<std::uint32_t> recent_;  ///< were near to what was asked about before; latest first
    int pieces_ = 0;                     ///< of the triangle that is being covered
    Double3 miss_{};
    double largest_ = 0;
};

}  // namespace isonest::detail
