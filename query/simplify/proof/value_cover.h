// Whether the finest function stays near the isovalue on a triangle, proven.
//
// A tetrahedron of the nested grid cuts a convex polygon out of the triangle. The linear function
// of the tetrahedron has its extremes over the polygon at the polygon's corners, and the finest
// function differs from it by at most the tetrahedron's deviation. If that is not conclusive, the
// polygon is divided as the tetrahedron is bisected, and both halves are tested; at the finest
// level the deviation is 0. Source of the branch and bound: R. Moore, R. Kearfott, M. Cloud,
// "Introduction to Interval Analysis" (2009), chapter 11, with the paper's nested tetrahedra
// instead of boxes.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <isonest/int3.h>

#include "query/simplify/block_grid.h"
#include "query/simplify/proof/point_triangle.h"
#include "query/traverse/adapt_traverse.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// Interface of a proof that the data stay near the isovalue on a triangle.

/// U is the finest function of the volume, for one type of cells. Not thread-safe.
class ValueProof {
  public:
    ValueProof() = default;
    ValueProof(const ValueProof&) = delete;
    ValueProof& operator=(const ValueProof&) = delete;
    virtual ~ValueProof() = default;

    /// Whether |U - iso| is proven to be at most the limit on all of the triangle (world
    /// coordinates).
    [[nodiscard]] virtual bool covers(const Triangle& t) = 0;
    /// After covers() was true: bound of |U - iso| on the triangle; at most the limit.
    [[nodiscard]] virtual double largest() const = 0;
    /// Whether a single evaluation at a point (world coordinates) shows that no triangle with this
    /// point is covered. Also returns false if that would take more than one evaluation.
    [[nodiscard]] virtual bool misses(const Double3& /*p*/) { return false; }
    /// A bound of |U - iso| on the triangle, independent of the limit; infinite: unknown.
    [[nodiscard]] virtual double max_on(const Triangle& /*t*/) {
        return std::numeric_limits<double>::infinity();
    }
    /// Estimate of the maximum change of U over a short way from a point (world coordinates), in
    /// units of the data per world unit. NaN: unknown.
    [[nodiscard]] virtual double slope(const Double3& /*p*/) {
        return std::numeric_limits<double>::quiet_NaN();
    }
    /// Releases cached data because no calls follow for a while.
    virtual void rest() = 0;
};

// A tree of the tetrahedra of the nested grid that were visited by proofs.
//
// Source of the grid: section 2 of Gerstner, Rumpf, Weikard (2000);
// query/traverse/adapt_traverse.h. A tetrahedron is created when the halves of its parent are first
// requested, so each number of the volume is looked up only once.

/// Numbers at nodes of a volume's nested grid, by coordinates of the finest lattice. May cache: one
/// per thread.
class GridNumbers {
  public:
    GridNumbers() = default;
    GridNumbers(const GridNumbers&) = delete;
    GridNumbers& operator=(const GridNumbers&) = delete;
    virtual ~GridNumbers() = default;
    /// U at a node of the lattice of `level` or a coarser one; NaN or infinite: missing.
    virtual double value(const Int3& node, int level) = 0;
    /// Maximum difference between the finest function and the linear function on tetrahedra that
    /// are bisected at this refinement node. Infinite: unknown.
    virtual double deviation(const Int3& node) = 0;
    /// Releases cached data because no calls follow for a while.
    virtual void rest() = 0;
};

struct ValueTetrahedron {
    std::array<double, 4> value{};  ///< U minus the isovalue, in the order of Element::v
    double deviation = 0;  ///< of the finest function from the linear one; 0 at the finest level
    /// Maximum of |U - iso| in it. Infinite or NaN: unknown.
    double most = 0;
    std::uint32_t first_child = 0;  ///< the other child follows; 0: not created
    std::int8_t kind = 0;           ///< as of Element
    std::int8_t level = 0;
    std::array<std::array<std::int32_t, 3>, 4> node{};
};

/// Not thread-safe.
class ValueTree {
  public:
    /// Maximum number of tetrahedra at a time.
    static constexpr std::uint32_t kMax = 1U << 17U;
    static constexpr std::uint64_t kBytes = std::uint64_t{kMax} * sizeof(ValueTetrahedron);

    /// `numbers` must outlive this object. REQUIRES: lattice.dimension() == 3.
    ValueTree(GridNumbers& numbers, const Lattice& lattice, double iso);

    /// The six coarsest tetrahedra are 0 ... 5, in the order of kAxisOrders.
    static constexpr std::uint32_t kRoots = 6;
    [[nodiscard]] const ValueTetrahedron& at(std::uint32_t i) const { return all_[i]; }
    /// The first of the two halves of a tetrahedron above the finest level, in the order of
    /// Element::bisect(). May invalidate references to others. Nothing: there is no room left; call
    /// clear().
    std::optional<std::uint32_t> children_of(std::uint32_t i);
    /// Removes everything except the roots.
    void clear();
    /// Releases the cache of the numbers.
    void rest() { numbers_.rest(); }

  private:
    [[nodiscard]] ValueTetrahedron described(const Element<3>& element);

    GridNumbers& numbers_;
    double iso_;
    std::vector<ValueTetrahedron> all_;
};

/// Not thread-safe.
class ValueCover : public ValueProof {
  public:
    /// `limit`: in units of the data, > 0. `tree` must outlive this object.
    ValueCover(ValueTree& tree, const WorldLattice& lattice, double limit);

    /// Whether |U - iso| is at most the limit on all of the triangle (world coordinates). Corners
    /// outside the volume are moved to its border; because of rounding, points are moved by up to
    /// 2^-46 of the edge of the coarsest cube. Also returns false if values are missing, or if only
    /// rounding could make it true. A triangle may be a segment or a point.
    [[nodiscard]] bool covers(const Triangle& t) override;
    [[nodiscard]] double largest() const override { return largest_; }
    void rest() override { tree_.rest(); }

  private:
    static constexpr std::size_t kLevels = 22;
    enum class Answer : std::uint8_t { yes, no, no_room };
    using Barycentric = std::array<double, 4>;
    /// In a tetrahedron; convex, so each cut adds at most one corner.
    struct Polygon {
        static constexpr std::size_t kMax = 16;
        std::array<Barycentric, kMax> corner;
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
    /// Maximum movement of a point by rounding, in barycentric coordinates of a tetrahedron of each
    /// level. A position is rounded when it is converted to coordinates of the coarsest cube, and
    /// by each cut and each bisection, by less than eight units of 2^-53 of the size of the
    /// bisected tetrahedron; these sizes are a geometric series. So the total is below 2^-46 of the
    /// coarsest cube, which is 2^(top - level) times as much relative to a tetrahedron of a level.
    std::array<double, kLevels> slack_{};
    double largest_ = 0;
};

}  // namespace isonest::detail
