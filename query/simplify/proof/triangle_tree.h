// A tree of boxes around triangles: which of them are near a point.
//
// Source of the bounding volume hierarchy: C. Ericson, "Real-Time Collision Detection" (2005),
// chapter 6: top-down, halves by the median along the longest axis.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

class TriangleTree {
  public:
    static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
    /// Heap per triangle, at most.
    static constexpr std::size_t kBytesPerTriangle = 96;
    struct Found {
        std::uint32_t triangle = kNone;
        double square_distance = std::numeric_limits<double>::infinity();
    };
    using Corners = std::array<std::uint32_t, 3>;

    /// `positions` have to live as long as the tree; `triangles` are copied.
    TriangleTree(std::span<const std::array<float, 3>> positions, std::vector<Corners> triangles);

    [[nodiscard]] std::size_t size() const { return triangles_.size(); }
    [[nodiscard]] const Corners& corners(std::uint32_t i) const { return triangles_[i]; }
    [[nodiscard]] Triangle triangle(std::uint32_t i) const {
        const Corners& c = triangles_[i];
        return {point(c[0]), point(c[1]), point(c[2])};
    }
    /// The nearest triangle no further than the root of `most`; none: kNone. Of several as near,
    /// any, but the same one always.
    [[nodiscard]] Found nearest(const Double3& p, double most) const;
    /// visit(triangle) for all no further, and for some that are, until it returns true; whether it
    /// did. Near ones come before far ones more often than not.
    template <class Visit>
    bool near(const Double3& p, double most, const Visit& visit) const {
        return !nodes_.empty() && square_to_box(p, nodes_[0]) <= most && descend(0, p, most, visit);
    }

  private:
    struct Node {
        std::array<float, 3> lo;
        std::array<float, 3> hi;
        std::uint32_t first = 0;  ///< of a leaf: in order_; else the second child
        std::uint32_t count = 0;  ///< 0: not a leaf, the first child follows
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

}  // namespace isonest::detail
