// Whether the finest function stays near to the isovalue on a triangle, proven.
//
// A tetrahedron of the nested grid cuts a convex polygon out of the triangle. The linear function
// of the tetrahedron has its extremes over the polygon at the polygon's corners, and the finest
// function differs from it by no more than the tetrahedron's deviation. Where that does not decide,
// the polygon is cut as the tetrahedron is bisected, and the question asked of both halves; at the
// finest level the deviation is 0. Source of the branch and bound: R. Moore, R. Kearfott, M. Cloud,
// "Introduction to Interval Analysis" (2009), chapter 11, with the paper's nested tetrahedra in
// place of boxes.
#pragma once

#include <array>
#include <cstdint>

#include "query/simplify/block_grid.h"
#include "query/simplify/by_value/value_tree.h"
#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

/// Not thread-safe.
class ValueCover {
  public:
    /// `limit`: in units of the data, > 0. `tree` has to stay.
    ValueCover(ValueTree& tree, const WorldLattice& lattice, double limit);

    /// Whether |U - iso| is at most the limit on all of the triangle (world coordinates): its
    /// corners moved to the volume's border if they lie outside, its points moved by up to 2^-46
    /// of the edge of the coarsest cube, because computing rounds. False as well where values are
    /// missing, and where only rounding could make it true. A triangle may be a segment or a point.
    [[nodiscard]] bool covers(const Triangle& t);
    /// |U - iso| was not larger on the triangle, after covers() was true; at most the limit.
    [[nodiscard]] double largest() const { return largest_; }

  private:
    static constexpr std::size_t kLevels = 22;
    enum class Answer : std::uint8_t { yes, no, no_room };
    using Barycentric = std::array<double, 4>;
    /// In a tetrahedron; convex, so that each cut adds one corner at most.
    struct Polygon {
        static constexpr std::size_t kMost = 16;
        std::array<Barycentric, kMost> corner;
        std::size_t count = 0;
    };
    Answer ask(const std::array<Double3, 3>& unit);
    Answer inside(std::uint32_t tetrahedron, const Polygon& polygon);
    Answer inside_children(std::uint32_t tetrahedron, const Polygon& polygon);
    [[nodiscard]] double slack_of(int level) const {
        return slack_[static_cast<std::size_t>(level)];
    }

    ValueTree& tree_;
    WorldLattice lattice_;
    double limit_;
    double scale_;  ///< from lattice coordinates to the edge of the coarsest cube
    int top_;
    /// By how much rounding may move a point, in barycentric coordinates of a tetrahedron of each
    /// level. A position is rounded when it becomes a coordinate of the coarsest cube, and by each
    /// cut and each bisection, by less than eight units of 2^-53 of the size of the tetrahedron
    /// that is bisected; these sizes are a geometric series. So all of it together is below 2^-46
    /// of the coarsest cube, and that is 2^(top - level) times as much of a tetrahedron of a level.
    std::array<double, kLevels> slack_{};
    double largest_ = 0;
};

}  // namespace isonest::detail
