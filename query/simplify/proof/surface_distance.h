// Whether two surfaces of triangles stay within a distance of each other, proven.
//
// The distance from a convex set is a convex function, so over a triangle it is largest at a
// corner: if one triangle of the other surface is within the limit of all three corners, it is of
// every point between them. Where no single one is, the triangle is cut: a bound, not a sample.
// Source of the branch and bound: M. Guthe, P. Borodin, R. Klein, "Fast and accurate Hausdorff
// distance calculation between meshes", Journal of WSCG 13 (2005).
#pragma once

#include <vector>

#include "query/simplify/proof/triangle_tree.h"

namespace isonest::detail {

/// Distances from one surface. Not thread-safe.
class SurfaceDistance {
  public:
    /// `limit`: > 0.
    SurfaceDistance(const TriangleTree& surface, double limit)
        : surface_(surface), square_limit_(limit * limit) {}

    /// Whether every point of `t` is within the limit of the surface. REQUIRES: nothing of
    /// triangles much larger than the surface's.
    [[nodiscard]] bool serves(const Triangle& t);
    /// The triangles that do, after serves() was true: one, if one alone does.
    [[nodiscard]] const std::vector<std::uint32_t>& servers() const { return servers_; }
    /// Where, after serves() was false.
    [[nodiscard]] const Double3& miss() const { return miss_; }
    /// After serves() was true: no point of `t` is further away than this; at most the limit.
    [[nodiscard]] double largest() const { return largest_; }

  private:
    bool serve(const Triangle& t, int depth);
    bool served_by(const Triangle& t, std::uint32_t server);
    void remember(std::uint32_t triangle, std::size_t place);

    const TriangleTree& surface_;
    double square_limit_;
    std::vector<std::uint32_t> servers_;
    std::vector<std::uint32_t> recent_;  ///< were near to what was asked about before; latest first
    Double3 miss_{};
    double largest_ = 0;
};

}  // namespace isonest::detail
