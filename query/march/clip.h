// Clips triangles to an axis-aligned box.
//
// Source: I. Sutherland, G. Hodgman, "Reentrant polygon clipping", CACM 17 (1974). A new vertex is
// identified by the triangle edge and the plane that make it, so both triangles at the edge get the
// same vertex.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <tuple>
#include <vector>

#include <isonest/element.h>
#include <isonest/int3.h>
#include <isonest/world.h>

namespace isonest::detail {

/// A box in coordinates of the finest lattice, to which the surface is clipped.
struct ClipBox {
    Double3 lo{};
    Double3 hi{};
    /// If set, the surface is closed by caps in the box's faces.
    std::optional<Outside> close = {};
};

class ClipContext {
  public:
    struct CutVertex {
        std::uint32_t end0 = 0;  ///< the triangle edge's ends; end0 < end1
        std::uint32_t end1 = 0;
        std::uint32_t plane = 0;       ///< 2 axis + (0 low, 1 high)
        bool inside_triangle = false;  ///< where two planes meet inside a triangle: never shared
        Double3 position{};
        std::uint32_t from = 0;  ///< position is from + t (to - from)
        std::uint32_t to = 0;
        double t = 0;
    };
    /// New vertices are numbered from `first_new`.
    ClipContext(const ClipBox& box, std::function<const Double3&(std::uint32_t)> position,
                std::uint32_t first_new)
        : box_(box), old_position_(std::move(position)), first_new_(first_new) {}

    /// The parts of the triangle inside the closed box, as triangles; none if it only touches.
    /// Parts in a face of the box are kept. REQUIRES: the triangle does not belong to an element
    /// outside.
    std::vector<std::array<std::uint32_t, 3>> cut(const std::array<std::uint32_t, 3>& triangle);
    [[nodiscard]] const CutVertex& vertex(std::uint32_t v) const {
        return vertices_[v - first_new_];
    }
    [[nodiscard]] const Double3& position(std::uint32_t v) const {
        return v < first_new_ ? old_position_(v) : vertices_[v - first_new_].position;
    }
    /// Number of corners so far that lie in a face of the box, of triangles that extend beyond that
    /// face, except for corners on edges in the face. What is left of the triangles around such a
    /// corner may be several fans.
    [[nodiscard]] std::uint64_t cut_fans() const { return cut_fans_; }
    /// Whether another part may have the same cut vertex: only if both ends are open.
    [[nodiscard]] bool is_shared(std::uint32_t v, const std::vector<std::uint64_t>& open) const {
        const CutVertex& c = vertex(v);
        return !c.inside_triangle && open[c.end0] != 0 && open[c.end1] != 0;
    }

  private:
    /// A polygon corner, and the triangle edge (0, 1, 2) of the following side; 3 = a plane.
    struct Side {
        std::uint32_t v;
        std::size_t edge;
    };
    std::uint32_t crossing(const std::array<std::uint32_t, 3>& triangle, const Side& from,
                           const Side& to, std::uint32_t plane);

    ClipBox box_;
    std::function<const Double3&(std::uint32_t)> old_position_;
    std::uint32_t first_new_;
    std::vector<CutVertex> vertices_;
    std::uint64_t cut_fans_ = 0;
    std::map<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>, std::uint32_t> index_;
};

/// Position of the box from `low` to `high` relative to `box`, which is infinite along axes without
/// extent. If `box` is to be closed, boxes that touch it from inside are crossing: they contribute
/// to the caps.
inline Overlap overlap_of(const ClipBox& box, const Int3& low, const Int3& high) {
    const Overlap where = overlap_of(box.lo, box.hi, low, high);
    if (!box.close || where != Overlap::inside) {
        return where;
    }
    bool touches = false;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        touches = touches || static_cast<double>(low[axis]) == box.lo[a] ||
                  static_cast<double>(high[axis]) == box.hi[a];
    }
    return touches ? Overlap::crossing : Overlap::inside;
}

}  // namespace isonest::detail
