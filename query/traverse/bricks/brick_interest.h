// SimplexIsOfInterest in one brick of the fast path: by the bounds of an isosurface, or by the
// distance from a plane.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5. What query/traverse/interest.h says of single
// tetrahedra, with what a brick has of the values and of the bound's field. All members are
// decisions, or numbers for them.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>

#include "query/traverse/bricks/cube_nodes.h"
#include "query/traverse/culling.h"
#include "query/traverse/interest.h"
#include "query/traverse/lattice_plane.h"
#include "query/traverse/traversal_run.h"
#include "query/view/field_view.h"

namespace isonest::detail {

/// Which brick of the traversal.
struct BrickPlace {
    BrickPlace(const StoreLayout& layout, int of_level, const Int3& which)
        : level(of_level),
          brick(which),
          half(layout.header().chunk / 2),
          base(which * layout.header().chunk),
          stride(std::int64_t{1} << of_level) {}

    int level;
    Int3 brick;
    std::int64_t half;    ///< cubes of level + 1 per axis
    Int3 base;            ///< its first node, in nodes of its level
    std::int64_t stride;  ///< of those in the finest lattice
};

inline FieldView field_view(TraversalRun& run, Field field, const BrickPlace& at) {
    return run.layout().lattice().top() > 0
               ? FieldView(run.cache, field, at.level, at.brick, at.half)
               : FieldView();
}

/// Where the finest function may take the isovalue: U of the level, more or less the bound.
class IsovalueByBound {
  public:
    /// Whether the function that is marched is the same on all levels: no number is asked.
    static constexpr bool kExact = false;

    IsovalueByBound(TraversalRun& run, const BrickPlace& at)
        : source_(run.cache.source()),
          iso_(run.query.iso),
          close_(run.query.box.close),
          level_(at.level),
          bound_(field_view(run, run.query.bound, at)),
          scale_(bound_scale(run.query.bound, at.level, run.layout().header().spacing)),
          parents_scale_(bound_scale(run.query.bound, at.level + 1, run.layout().header().spacing)),
          ranged_(run.layout().has_cube_ranges(at.level)) {}

    [[nodiscard]] double iso() const { return iso_; }
    static void prepare(CubeNodes& /*nodes*/) {}
    [[nodiscard]] static const CubeValues& function(const CubeNodes& nodes) { return nodes.value; }

    /// The bound's field at the tetrahedron's refinement node. REQUIRES: the level is not 0.
    [[nodiscard]] double number(const CubeNodes& nodes, const TopologyTetrahedron& t) const {
        return bound_.at(nodes.value, nodes.low, nodes.mirror, t.ref_node);
    }
    [[nodiscard]] bool may_hold(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                double number) const {
        return holds(range_of(nodes.value, t), number * parents_scale_, nodes.cut);
    }
    /// On which sides of the isovalue the finest function can be: above level 0 that takes the
    /// centres of the subcubes.
    [[nodiscard]] Sides sides(const CubeNodes& nodes) const {
        if (level_ == 0) {
            return sides_of(nodes.value, iso_);
        }
        std::array<double, 8> bound{};
        for (unsigned corner = 0; corner < 8; ++corner) {
            bound[corner] = centre(nodes.subcube(corner)) * scale_;
        }
        return sides_of(nodes.value, bound, iso_);
    }

    /// Whether the range of a cube's values excludes it. `cut`: it reaches across the box.
    [[nodiscard]] bool excludes(const Int3& cube, bool cut) const {
        if (!ranged_) {
            return false;
        }
        const auto range = source_.cube_range(level_, cube);
        return range && !range->may_hold(iso_) &&
               !(cut && close_ && may_be_solid(range->low, range->high, 0, iso_, *close_));
    }
    /// The bound's field at a cube's centre. REQUIRES: the level is not 0.
    [[nodiscard]] double centre(const Int3& cube) const { return bound_.centre(cube); }
    /// Of tetrahedra of a subcube with these vertices in all: whether one may hold it.
    [[nodiscard]] bool one_may_hold(const CubeNodes& nodes, std::uint32_t vertices, double centre,
                                    bool cut) const {
        return holds(range_of(nodes.value, vertices), centre * scale_, cut);
    }
    [[nodiscard]] bool may_hold_below(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                      double centre, bool cut) const {
        return holds(range_of(nodes.value, t), centre * scale_, cut);
    }

  private:
    [[nodiscard]] bool holds(const std::pair<double, double>& range, double beta, bool cut) const {
        return may_reach(range.first, range.second, beta, iso_) ||
               (cut && close_ && may_be_solid(range.first, range.second, beta, iso_, *close_));
    }

    const ChunkSource& source_;
    double iso_;
    std::optional<Outside> close_;
    int level_;
    FieldView bound_;
    double scale_;
    double parents_scale_;
    bool ranged_;
};

/// Where a plane passes. Its function is linear, so that every element shows it exactly, and
/// nothing but the stop test refines.
class PlaneByDistance {
  public:
    static constexpr bool kExact = true;

    PlaneByDistance(TraversalRun& run, const BrickPlace& at)
        : plane_(*run.query.plane), stride_(at.stride) {}

    [[nodiscard]] static double iso() { return 0; }
    void prepare(CubeNodes& nodes) const {
        nodes.distance = plane_.distances(nodes.low, nodes.mirror, stride_);
    }
    [[nodiscard]] static const CubeValues& function(const CubeNodes& nodes) {
        return nodes.distance;
    }
    [[nodiscard]] static double number(const CubeNodes& /*nodes*/,
                                       const TopologyTetrahedron& /*t*/) {
        return 0;
    }
    /// What sides() says is all.
    [[nodiscard]] static bool may_hold(const CubeNodes& /*nodes*/, const TopologyTetrahedron& /*t*/,
                                       double /*number*/) {
        return true;
    }
    [[nodiscard]] static Sides sides(const CubeNodes& nodes) { return sides_of(nodes.distance, 0); }
    [[nodiscard]] static bool excludes(const Int3& /*cube*/, bool /*cut*/) { return false; }
    [[nodiscard]] static double centre(const Int3& /*cube*/) { return 0; }
    [[nodiscard]] static bool one_may_hold(const CubeNodes& nodes, std::uint32_t vertices,
                                           double /*centre*/, bool /*cut*/) {
        return may_cross_any(nodes.distance, vertices, 0, 0);
    }
    [[nodiscard]] static bool may_hold_below(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                             double /*centre*/, bool /*cut*/) {
        return may_cross(nodes.distance, t, 0, 0);
    }

  private:
    LatticePlane plane_;
    std::int64_t stride_;
};

/// Whether the surface in a tetrahedron and below it faces away from the viewer; never without a
/// viewer. Of bricks of the two finest levels the bounds are not asked: they are more bytes than
/// what they leave out, and the leaves there are tested by themselves.
class CullingInBrick {
  public:
    CullingInBrick(TraversalRun& run, const BrickPlace& at)
        : culling_(run.query.culling ? &*run.query.culling : nullptr),
          stride_(at.stride),
          has_bounds_(culling_ != nullptr && at.level >= kLeastLevel) {
        if (has_bounds_) {
            field_ = field_view(run, culling_->field(), at);
        }
    }
    [[nodiscard]] bool all_below(const CubeNodes& nodes, const TopologyTetrahedron& t) const {
        return has_bounds_ &&
               faces_away(nodes, t, field_.at(nodes.value, nodes.low, nodes.mirror, t.ref_node));
    }
    /// `t`: a tetrahedron of the subcube `cube`.
    [[nodiscard]] bool all_below(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                 const Int3& cube) const {
        return has_bounds_ && faces_away(nodes, t, field_.centre(cube));
    }
    [[nodiscard]] bool leaf(const CubeNodes& nodes, const TopologyTetrahedron& t) const {
        return culling_ != nullptr && faces_away(nodes, t, 0);
    }

  private:
    [[nodiscard]] bool faces_away(const CubeNodes& nodes, const TopologyTetrahedron& t,
                                  double beta) const {
        return culling_->faces_away(nodes.value, t, nodes.mirror, stride_, beta);
    }
    static constexpr int kLeastLevel = 2;
    const Culling* culling_;
    std::int64_t stride_;
    bool has_bounds_;
    FieldView field_;
};

}  // namespace isonest::detail
