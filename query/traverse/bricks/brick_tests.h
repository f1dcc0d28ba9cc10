// SimplexIsOfInterest and the stop test within one brick of the fast path. Interest is tested by
// the bounds of an isosurface or by the distance from a plane, and by orientation.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5. These are the tests of
// query/traverse/interest.h for single tetrahedra, with the values and bounds of a brick. All
// members are decisions, or numbers for them.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>

#include <isonest/value_type.h>

#include "query/traverse/interest.h"
#include "query/traverse/traversal.h"
#include "query/values/brick_view.h"

namespace isonest::detail {

// State of one cube of the level above while a brick refines the cube's tetrahedra.

struct CubeNodes {
    CubeValues value;       ///< the data
    CubeValues distance;    ///< from the plane, if one is marched
    Int3 low;               ///< in nodes of the brick's level
    unsigned mirror = 0;    ///< axes along which the topology tables are mirrored
    Sides sides{~0U, ~0U};  ///< unrestricted, until `sharp`
    bool sharp = false;
    std::uint32_t special = 0;   ///< bit p: the value is the isovalue or missing, if this was
                                 ///< computed
    std::uint32_t asked = 0;     ///< bit p: it is known whether the node stops
    std::uint32_t stopping = 0;  ///< bit p: the node stops
    bool cut = false;            ///< extends across the box

    CubeNodes() = default;
    CubeNodes(const CubeNodes&) = delete;
    CubeNodes& operator=(const CubeNodes&) = delete;

    /// The subcube at a corner (bits x, y, z) of the tables' cube.
    [[nodiscard]] Int3 subcube(unsigned corner) const {
        return low + corner_offset(corner ^ mirror);
    }
};

/// Loads the values of cubes of the level above a brick's. Not thread-safe.
class CubeLoader {
  public:
    /// `base`: the brick's first node, in nodes of its level.
    CubeLoader(ChunkCache& cache, int level, const Int3& base)
        : array_(cache.source().layout().array(level, Field::values)),
          type_(cache.source().layout().header().type),
          base_(base),
          values_(cache, array_, base) {}

    /// Loads cube `parent` of the level above, mirrored as in the topology tables.
    void load(CubeNodes& nodes, const Int3& parent) const {
        load(nodes, parent, mirror_of(parent));
    }
    /// The same, mirrored along the axes set in `mirror`.
    void load(CubeNodes& nodes, const Int3& parent, unsigned mirror) const {
        nodes.low = parent * 2;
        nodes.mirror = mirror;
        dispatch(type_, [&](auto tag) { load_as<typename decltype(tag)::type>(nodes); });
    }

  private:
    template <class T>
    void load_as(CubeNodes& nodes) const {
        const Int3 last = array_.nodes - Int3{1, 1, 1} - base_;
        const Int3 low = nodes.low - base_;
        const T* const near = values_.within_first<T>(low, 2);
        const bool inside =
            near != nullptr && low.x + 2 <= last.x && low.y + 2 <= last.y && low.z + 2 <= last.z;
        for (int position = 0; position < 27; ++position) {
            const Int3 offset = node_offset(position, nodes.mirror);
            double& value = nodes.value[static_cast<std::size_t>(position)];
            if (inside) {
                value = static_cast<double>(near[array_.chunk.linear(offset)]);
                continue;
            }
            // Outside the lattice of this level (possible only for a parent that extends outside
            // the volume) the value of the nearest node is used.
            value = static_cast<double>(values_.at<T>(min(low + offset, last)));
        }
    }

    const ArrayInfo& array_;
    ValueType type_;
    Int3 base_;
    ChunkGroup values_;
};

/// Bits of the nodes of the tetrahedra in `mask`.
inline std::uint32_t nodes_of(const std::array<TopologyTetrahedron, 6>& tetrahedra,
                              std::uint8_t mask) {
    std::uint32_t nodes = 0;
    for (unsigned order = 0; order < 6; ++order) {
        nodes |= (mask >> order & 1U) != 0 ? tetrahedra[order].nodes : 0;
    }
    return nodes;
}

/// The position of a brick in the traversal.
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
    Int3 base;            ///< first node, in nodes of its level
    std::int64_t stride;  ///< of those nodes in the finest lattice
};

inline FieldView field_view(TraversalRun& run, Field field, const BrickPlace& at) {
    return run.layout().lattice().top() > 0
               ? FieldView(run.cache, field, at.level, at.brick, at.half)
               : FieldView();
}

/// Interest by values: the finest function may take the isovalue, given U of the level plus or
/// minus the bound.
class IsovalueByBound {
  public:
    /// Whether the marched function is the same on all levels, so that no number is needed.
    static constexpr bool kExact = false;

    IsovalueByBound(TraversalRun& run, const BrickPlace& at)
        : source_(run.cache.source()),
          iso_(run.query.iso),
          close_(run.query.box.close),
          level_(at.level),
          bound_(field_view(run, run.query.bound, at)),
          scale_(bound_scale(run.query.bound, at.level, run.layout().header().steps())),
          parents_scale_(bound_scale(run.query.bound, at.level + 1, run.layout().header().steps())),
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
    /// On which sides of the isovalue the finest function can be. Above level 0 this uses the
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

    /// Whether the range of a cube's values excludes the surface. `cut`: the cube extends across
    /// the box.
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
    /// Whether one of the tetrahedra of a subcube may contain the surface. `vertices`: all their
    /// vertices.
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

/// Interest by the distance from a plane. This function is linear, so every element represents it
/// exactly and only the stop test causes refinement.
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
    /// sides() is the only criterion.
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

/// Whether the surface in a tetrahedron and its descendants faces away from the viewer; always
/// false without a viewer. In the two finest levels bounds are not used: they are larger than the
/// data they would save, and the leaves there are tested individually.
class CullingInBrick {
  public:
    CullingInBrick(TraversalRun& run, const BrickPlace& at)
        : culling_(run.query.culling ? &*run.query.culling : nullptr),
          stride_(at.stride),
          has_bounds_(culling_ != nullptr && at.level >= kMinLevel) {
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
    static constexpr int kMinLevel = 2;
    const Culling* culling_;
    std::int64_t stride_;
    bool has_bounds_;
    FieldView field_;
};

/// The stop test: nodes whose field is below the query's tolerance stop. All members are decisions,
/// or numbers for them.
class BrickStop {
  public:
    BrickStop(TraversalRun& run, const BrickPlace& at)
        : tolerance_(run.query.tolerance),
          stride_(at.stride),
          is_bound_(run.query.stop == run.query.bound),
          field_(field_view(run, run.query.stop, at)) {}

    /// Whether no node stops, so that no test is needed.
    [[nodiscard]] bool never() const { return tolerance_.is_zero(); }
    /// Whether the interest test's number is also this test's number.
    [[nodiscard]] bool is_bound() const { return is_bound_; }
    /// The field at a refinement node of the cube's tetrahedra, and at a subcube's centre. The
    /// latter REQUIRES: the level is not 0.
    [[nodiscard]] double number(const CubeNodes& nodes, int position) const {
        return field_.at(nodes.value, nodes.low, nodes.mirror, position);
    }
    [[nodiscard]] double centre(const Int3& cube) const { return field_.centre(cube); }
    [[nodiscard]] bool stops(const CubeNodes& nodes, int position, double eta) const {
        const Int3 twice = (nodes.low + node_offset(position, nodes.mirror)) * (2 * stride_);
        return tolerance_.stops(eta, twice, 2 * stride_);
    }
    [[nodiscard]] bool stops_centre(const Int3& cube, double eta) const {
        return tolerance_.stops(eta, (cube * 2 + Int3{1, 1, 1}) * stride_, stride_);
    }

  private:
    const Tolerance& tolerance_;
    std::int64_t stride_;
    bool is_bound_;
    FieldView field_;
};

}  // namespace isonest::detail
