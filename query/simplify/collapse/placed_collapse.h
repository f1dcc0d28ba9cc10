// The collapse of an edge into a vertex at another place than its ends, as it is looked at before
// it is made.
//
// The vertices of the smallest mesh near to a surface do not lie on that surface: where it is
// curved to one side, a mesh with its vertices on it is on the other side everywhere else. Source
// of the place: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics",
// SIGGRAPH 1997, "optimal placement".
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// Not thread-safe.
class PlacedCollapse {
  public:
    /// A triangle as it will be.
    struct Placed {
        std::uint32_t triangle = 0;  ///< its place in the patch
        PatchTriangle corners{};     ///< vertices of the patch
        Triangle at;
        StarCollapse::Normal normal{};
    };

    /// As those of StarCollapse, and all have to stay.
    PlacedCollapse(std::span<const std::array<float, 3>> positions, const PatchBox& box,
                   const std::vector<bool>& shared, const CornerMesh& mesh)
        : positions_(positions), box_(box), shared_(shared), mesh_(mesh) {}

    /// Whether the edge can be collapsed into its end at `place` (world coordinates): none of its
    /// ends and no other vertex of the box's faces is moved, nothing leaves the box, all triangles
    /// have an area, also in float32, and turn by less than 84 degrees. REQUIRES: the last
    /// `half`.look() was true and had this edge, whose end is not locked.
    [[nodiscard]] bool look(const StarCollapse& half, const std::array<float, 3>& place);
    /// Whether the sharpest of the edges of the changed triangles is bent by no more than this
    /// after, or than before; as StarCollapse::has_no_new_fold(). REQUIRES: look() was true.
    [[nodiscard]] bool has_no_new_fold(const StarCollapse& half, float least) const;

    // After look() was true:

    [[nodiscard]] const std::array<float, 3>& place() const { return place_; }
    /// The triangles around both ends: places in the patch.
    [[nodiscard]] std::span<const std::uint32_t> before() const { return before_; }
    /// Those that take their places, two fewer.
    [[nodiscard]] std::span<const Placed> after() const { return after_; }

  private:
    [[nodiscard]] bool is_inside_box(const std::array<float, 3>& p) const;
    void gather(const CornerMesh::Ring& ring);
    [[nodiscard]] bool add(std::uint32_t triangle, const StarCollapse& half);
    [[nodiscard]] bool is_gone(std::uint32_t triangle) const;
    [[nodiscard]] std::uint32_t across(std::uint32_t half_edge) const;

    std::span<const std::array<float, 3>> positions_;
    PatchBox box_;
    const std::vector<bool>& shared_;
    const CornerMesh& mesh_;
    std::uint32_t from_ = 0;
    std::uint32_t to_ = 0;
    std::array<float, 3> place_{};
    CornerMesh::Ring ring_;  ///< around `to_`
    std::vector<std::uint32_t> before_;
    std::vector<std::uint32_t> gone_;
    std::vector<Placed> after_;
};

}  // namespace isonest::detail
