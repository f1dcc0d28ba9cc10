// Whether two surfaces of triangles are within a distance of each other, proven.
//
// The distance from a convex set is a convex function, so over a triangle its maximum is at a
// corner: if one triangle of the other surface is within the limit of all three corners, it is
// within the limit of every point between them. If there is no such triangle, the triangle is
// divided: the result is a bound, not a sample. Source of the branch and bound: M. Guthe, P.
// Borodin, R. Klein, "Fast and accurate Hausdorff distance calculation between meshes", Journal of
// WSCG 13 (2005).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

// A tree of boxes around triangles, to find those near a point.
//
// Source of the bounding volume hierarchy: C. Ericson, "Real-Time Collision Detection" (2005),
// chapter 6: top-down, divided by the median along the longest axis.

class TriangleTree {
  public:
    static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
    /// Maximum heap per triangle.
    static constexpr std::size_t kBytesPerTriangle = 96;
    struct Found {
        std::uint32_t triangle = kNone;
        double square_distance = std::numeric_limits<double>::infinity();
    };
    using Corners = std::array<std::uint32_t, 3>;

    /// `positions` must outlive the tree; `triangles` are copied.
    TriangleTree(std::span<const std::array<float, 3>> positions, std::vector<Corners> triangles);

    [[nodiscard]] std::size_t size() const { return triangles_.size(); }
    [[nodiscard]] const Corners& corners(std::uint32_t i) const { return triangles_[i]; }
    [[nodiscard]] Triangle triangle(std::uint32_t i) const {
        const Corners& c = triangles_[i];
        return {point(c[0]), point(c[1]), point(c[2])};
    }
    /// The nearest triangle within the square root of `most`; kNone if there is none. If several
    /// are equally near, any of them, but always the same one.
    [[nodiscard]] Found nearest(const Double3& p, double most) const;
    /// Calls visit(triangle) for all triangles within the square root of `most`, and for some that
    /// are further away, until it returns true. Returns whether it did. Near triangles usually come
    /// before distant ones.
    template <class Visit>
    bool near(const Double3& p, double most, const Visit& visit) const {
        return !nodes_.empty() && square_to_box(p, nodes_[0]) <= most && descend(0, p, most, visit);
    }

  private:
    struct Node {
        std::array<float, 3> lo;
        std::array<float, 3> hi;
        std::uint32_t first = 0;  ///< of a leaf: index into order_; otherwise the second child
        std::uint32_t count = 0;  ///< 0: not a leaf; the first child follows
    };
    static constexpr std::uint32_t kLeaf = 4;

    [[nodiscard]] Double3 point(std::uint32_t v) const { return point_at(positions_[v]); }
    void build(std::uint32_t first, std::uint32_t count,
               const std::vector<std::array<float, 3>>& middles);
    static double square_to_box(const Double3& p, const Node& node) {
        double sum = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            const double out = std::max({static_cast<double>(node.lo[a]) - p[a],
                                         p[a] - static_cast<double>(node.hi[a]), 0.0});
            sum += out * out;
        }
        return sum;
    }
    template <class Visit>
    bool descend(std::uint32_t at, const Double3& p, double most, const Visit& visit) const {
        const Node& node = nodes_[at];
        if (node.count == 0) {
            const double first = square_to_box(p, nodes_[at + 1]);
            const double second = square_to_box(p, nodes_[node.first]);
            const bool swap = second < first;
            const std::uint32_t near = swap ? node.first : at + 1;
            const std::uint32_t far = swap ? at + 1 : node.first;
            return (std::min(first, second) <= most && descend(near, p, most, visit)) ||
                   (std::max(first, second) <= most && descend(far, p, most, visit));
        }
        return std::any_of(order_.begin() + node.first, order_.begin() + node.first + node.count,
                           visit);
    }
    void closest(std::uint32_t at, const Double3& p, Found& found) const;

    std::span<const std::array<float, 3>> positions_;
    std::vector<Corners> triangles_;
    std::vector<std::uint32_t> order_;
    std::vector<Node> nodes_;
};

/// Distances from one surface. Not thread-safe.
class SurfaceDistance {
  public:
    /// `limit`: > 0.
    SurfaceDistance(const TriangleTree& surface, double limit)
        : surface_(surface), square_limit_(limit * limit) {}

    /// Whether every point of `t` is proven to be within the limit of the surface. Not meant for
    /// triangles much larger than the surface's: the number of divisions is limited.
    [[nodiscard]] bool serves(const Triangle& t);
    /// After serves() was true: the triangles that are within the limit; only one, if one is
    /// sufficient.
    [[nodiscard]] const std::vector<std::uint32_t>& witnesses() const { return witnesses_; }
    /// After serves() was false: a point that is too far away.
    [[nodiscard]] const Double3& miss() const { return miss_; }
    /// After serves() was true: maximum distance of a point of `t`; at most the limit.
    [[nodiscard]] double largest() const { return largest_; }

  private:
    bool serve(const Triangle& t, int depth);
    bool served_by(const Triangle& t, std::uint32_t witness);
    void remember(std::uint32_t triangle, std::size_t place);

    const TriangleTree& surface_;
    double square_limit_;
    std::vector<std::uint32_t> witnesses_;
    std::vector<std::uint32_t> recent_;  ///< triangles near the previous queries; latest first
    Double3 miss_{};
    double largest_ = 0;
};

}  // namespace isonest::detail
