// The interest test: whether the finest function can take the isovalue in a tetrahedron.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5, beta_0: |U - U^l| <= beta in the tetrahedron
// (U is the finest function, U^l the linear one on the tetrahedron; the paper's l grows from coarse
// to fine, by one per bisection, the other way than our levels),
// so U stays within the values of its vertices plus or minus beta. Here beta is the saturated
// deviation (or eta_plus), not the eta_plus / 2 that the paper prints and that is not a bound.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include <isonest/element.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/world.h>

#include "query/values/brick_view.h"
#include "query/values/topology.h"
#include "store/base/vectors.h"
#include "store/container/format.h"

namespace isonest::detail {

// The plane of a slice.

/// The plane {normal . p = offset}, in coordinates of the finest lattice.
struct LatticePlane {
    Double3 normal{0, 0, 1};
    double offset = 0;

    [[nodiscard]] double distance(const Int3& p) const {
        return normal[0] * static_cast<double>(p.x) + normal[1] * static_cast<double>(p.y) +
               normal[2] * static_cast<double>(p.z) - offset;
    }
    /// Distances of the 27 nodes of the cube with low corner `low`, in the lattice of this stride.
    [[nodiscard]] CubeValues distances(const Int3& low, unsigned mirror,
                                       std::int64_t stride) const {
        CubeValues out{};
        for (int p = 0; p < 27; ++p) {
            out[static_cast<std::size_t>(p)] = distance((low + node_offset(p, mirror)) * stride);
        }
        return out;
    }
};

/// Converts a plane to lattice coordinates. If the plane touches the volume, its normal is chosen
/// so that something lies strictly below the plane: slices along the volume's border are then not
/// empty. Throws Error{invalid_argument} if the normal is 0 or a number is not finite.
LatticePlane lattice_plane(const StoreHeader& header, const WorldPlane& world);

// Backface culling of whole subtrees, for a parallel view.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: an element whose descendants all face away
// need not be visited. The surface's normals point to smaller values, so the surface faces away
// from a viewer who looks along V where grad U . V <= 0. With beta_1 = eta_plus of |grad U_delta|,
// the gradient of every descendant is within beta_1 of the element's gradient. The same holds for
// the normals with beta_N = plus of the turn of the unit gradient (not of eta_N, see
// preprocess/indicators/normal_indicators.h).

class Culling {
  public:
    /// `view`: viewing direction, world units, any length but 0. `field`: grad_linf_plus or
    /// normal_turn_plus, which bounds the change.
    Culling(const Double3& view, Field field, const LatticeSteps& steps);

    [[nodiscard]] Field field() const {
        return by_normal_ ? Field::normal_turn_plus : Field::grad_linf_plus;
    }
    /// Whether all surface in the element and its descendants faces away. `beta`: the field at its
    /// refinement node; 0 tests the element alone. `stride`: of the lattice of the values.
    [[nodiscard]] bool faces_away(const CubeValues& values, const TopologyTetrahedron& t,
                                  unsigned mirror, std::int64_t stride, double beta) const;

  private:
    /// For one tetrahedron of the tables, in an unmirrored cube of stride 1.
    struct Weights {
        /// The gradient is the sum over i of row i times (value at vertex i + 1 minus value at
        /// vertex 0).
        std::array<Double3, 3> row{};
        double size = 0;  ///< length of the longest row
    };
    bool by_normal_;
    LatticeSteps steps_;
    std::array<Double3, 8> view_{};  ///< unit length, by the mirror of the cube, in lattice axes
    std::array<Weights, kTopologySize> weights_{};
};

// An error tolerance that depends on the position of a node: finer near a point or a box, or
// according to a camera.
//
// A mesh without cracks needs a test that holds for a node whenever it holds for one of its
// children (section 5 of the paper). So a node uses the strictest tolerance in a ball around it
// that contains the balls of its children; then no saturation is needed. Source of the nested
// balls: P. Lindstrom, V. Pascucci, "Visualization of large terrains made easy", IEEE Visualization
// 2001.

class Tolerance {
  public:
    /// `threshold`: a node stops below it, unless modified by focus or camera. Focus and camera are
    /// in own axes.
    Tolerance(double threshold, const std::optional<Focus>& focus,
              const std::optional<Camera>& camera, const LatticeSteps& steps,
              const Double3& origin);

    /// A node stops below it, unless modified by focus or camera.
    [[nodiscard]] double threshold() const { return threshold_; }
    /// Whether no node stops.
    [[nodiscard]] bool is_zero() const { return threshold_ <= 0 && !camera_; }
    /// Whether a node stops. `twice`: twice its coordinates in the finest lattice; its scale is
    /// `half_scale` / 2. `eta`: its stop field.
    [[nodiscard]] bool stops(double eta, const Int3& twice, std::int64_t half_scale) const {
        return varies_ ? eta < at(twice, half_scale) : eta < threshold_;
    }
    /// Replaces the uneven axes by an equal object, for example that of another process.
    void use_axes(const UnevenAxes* uneven) { steps_.uneven = uneven; }

  private:
    [[nodiscard]] double at(const Int3& twice, std::int64_t half_scale) const;

    double threshold_;
    std::optional<Focus> focus_;
    std::optional<Camera> camera_;
    bool varies_;
    LatticeSteps steps_;
    Double3 origin_;
    double step_;       ///< reduction of a ball's radius from centre to face, and from face to edge
    double reach_;      ///< radius of a centre's ball, per unit of scale
    double diagonal_;   ///< of a cell
    double pixel_ = 0;  ///< size of a pixel at distance 1
};

/// Whether an element at a closed face of the box can contribute to the cap there: values between
/// `low` and `high`, or up to beta beyond, that are not all on the side of the outside.
inline bool may_be_solid(double low, double high, double beta, double iso, Outside outside) {
    return outside == Outside::below ? !(high + beta < iso) : !(low - beta > iso);
}

/// The factor for the bound field at an element's refinement node that makes it a bound of |U -
/// U^l| there: 1, or for the gradient type the diagonal of the element's cube, of edge 2^level.
/// That is at least the paper's h(T), the element's diameter (section 5).
inline double bound_scale(Field bound, int level, const LatticeSteps& steps) {
    if (indicator_of(bound) != Indicator::grad_linf) {
        return 1;
    }
    // U - U^l is 0 at an element's vertices and changes by at most the gradient's bound along the
    // way to any other point. No point is further away than the diagonal of the element's cube.
    return std::ldexp(steps.diagonal(), level);
}

/// Smallest and largest value at a tetrahedron's vertices.
inline std::pair<double, double> range_of(const CubeValues& value, const TopologyTetrahedron& t) {
    double low = value[t.vertices[0]];
    double high = low;
    for (std::size_t i = 1; i < 4; ++i) {
        low = std::min(low, value[t.vertices[i]]);
        high = std::max(high, value[t.vertices[i]]);
    }
    return {low, high};
}

/// The same for a set of the 27 nodes (bits).
inline std::pair<double, double> range_of(const CubeValues& value, std::uint32_t nodes) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (; nodes != 0; nodes &= nodes - 1) {
        const double v = value[static_cast<std::size_t>(std::countr_zero(nodes))];
        low = std::min(low, v);
        high = std::max(high, v);
    }
    return {low, high};
}

/// Test by the tetrahedron's own vertices and bound.
inline bool may_cross(const CubeValues& value, const TopologyTetrahedron& t, double beta,
                      double iso) {
    const auto [low, high] = range_of(value, t);
    return may_reach(low, high, beta, iso);
}

/// The same for several tetrahedra with one bound and a common diagonal; `nodes`: bits of all their
/// vertices. One of them may cross if and only if they may cross together: where none crosses, each
/// is entirely on one side, and because of the common diagonal it is the same side.
inline bool may_cross_any(const CubeValues& value, std::uint32_t nodes, double beta, double iso) {
    const auto [low, high] = range_of(value, nodes);
    return may_reach(low, high, beta, iso);
}

/// What the 27 values of a cube and the bounds of its eight subcubes tell about the finest
/// function. In a subcube it stays within the values at the corners plus or minus the bound at the
/// centre. So a tetrahedron contains no surface if none of its nodes can be below the isovalue, or
/// none can be not below it. This is sharper than the tetrahedron's own bound, which is based on
/// the coarser function. With bounds of 0, at the finest level, it is exact.
struct Sides {
    // Bit p: near node position p the function may be below the isovalue (or not below it).
    std::uint32_t below = 0;
    std::uint32_t not_below = 0;

    /// `nodes`: bits of node positions.
    [[nodiscard]] bool both_in(std::uint32_t nodes) const {
        return (nodes & below) != 0 && (nodes & not_below) != 0;
    }
    [[nodiscard]] bool both_in(const TopologyTetrahedron& t) const { return both_in(t.nodes); }
    /// For an element at a closed face of the box: the outside is included.
    [[nodiscard]] Sides with(Outside outside) const {
        return outside == Outside::below ? Sides{~0U, not_below} : Sides{below, ~0U};
    }
};

namespace interest {

/// The node positions (x + 3 y + 9 z) of the eight subcubes' corners.
constexpr std::array<std::array<std::uint8_t, 8>, 8> make_corners() {
    std::array<std::array<std::uint8_t, 8>, 8> corners{};
    for (unsigned cube = 0; cube < 8; ++cube) {
        for (unsigned c = 0; c < 8; ++c) {
            const unsigned x = (cube & 1U) + (c & 1U);
            const unsigned y = (cube >> 1U & 1U) + (c >> 1U & 1U);
            const unsigned z = (cube >> 2U) + (c >> 2U);
            corners[cube][c] = static_cast<std::uint8_t>(x + 3 * y + 9 * z);
        }
    }
    return corners;
}
inline constexpr auto kCorners = make_corners();

}  // namespace interest

/// Sides without bounds, as at the finest level. Missing values are on neither side.
inline Sides sides_of(const CubeValues& value, double iso) {
    Sides sides;
    for (std::size_t p = 0; p < value.size(); ++p) {
        sides.below |= (value[p] < iso ? 1U : 0U) << p;
        sides.not_below |= (value[p] >= iso ? 1U : 0U) << p;
    }
    return sides;
}

/// Bits of the node positions where the value is the isovalue or missing.
inline std::uint32_t special_nodes(const CubeValues& value, double iso) {
    std::uint32_t special = 0;
    for (std::size_t p = 0; p < value.size(); ++p) {
        special |= (value[p] == iso || !std::isfinite(value[p]) ? 1U : 0U) << p;
    }
    return special;
}

/// `bound`: of the subcubes (bits x, y, z). Missing values: an infinite bound excludes nothing;
/// with bounds of 0 they are on neither side.
inline Sides sides_of(const CubeValues& value, const std::array<double, 8>& bound, double iso) {
    std::array<double, 27> around{};
    for (std::size_t cube = 0; cube < 8; ++cube) {
        for (const std::uint8_t p : interest::kCorners[cube]) {
            around[p] = std::max(around[p], bound[cube]);
        }
    }
    Sides sides;
    for (std::size_t p = 0; p < 27; ++p) {
        const double low = value[p] - around[p];
        const double high = value[p] + around[p];
        const bool unknown = around[p] > std::numeric_limits<double>::max();
        // A rounded difference may equal the isovalue although the function is below it.
        const bool below = unknown || low < iso || (around[p] > 0 && low == iso);
        const bool not_below = unknown || high >= iso;
        sides.below |= (below ? 1U : 0U) << p;
        sides.not_below |= (not_below ? 1U : 0U) << p;
    }
    return sides;
}

}  // namespace isonest::detail
