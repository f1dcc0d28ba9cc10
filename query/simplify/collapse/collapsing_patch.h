// A patch whose edges are collapsed one after the other, into one of their ends.
//
// Source: T. Dey, H. Edelsbrunner, S. Guha, D. Nekhayev, "Topology preserving edge contraction"
// (1999): the surface stays the same if the ends of the edge have no neighbours in common but
// those opposite to the edge.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// Triangles keep their places; those that a collapse takes away have no corners any more. Not
/// thread-safe.
class CollapsingPatch {
  public:
    /// `locked`: vertices that stay; no edge arises between two of them. REQUIRES: the link of each
    /// vertex that is not locked is a ring or a path. Both have to stay.
    CollapsingPatch(const Patch& patch, const std::vector<bool>& locked);

    [[nodiscard]] const std::vector<PatchTriangle>& triangles() const { return triangles_; }
    [[nodiscard]] static bool is_gone(const PatchTriangle& t) { return t[0] == t[1]; }
    /// Places of the triangles with this vertex.
    [[nodiscard]] const std::vector<std::uint32_t>& around(std::uint32_t v) const {
        return around_[v];
    }
    static bool has(const PatchTriangle& t, std::uint32_t v) {
        return t[0] == v || t[1] == v || t[2] == v;
    }
    static PatchTriangle moved(PatchTriangle t, std::uint32_t from, std::uint32_t to) {
        std::replace(t.begin(), t.end(), from, to);
        return t;
    }
    /// The vertices that share an edge with `v`.
    void neighbours_of(std::uint32_t v, std::vector<std::uint32_t>& found) const;
    [[nodiscard]] bool is_border(std::uint32_t a, std::uint32_t b) const {
        return shared_triangles(a, b) == 1;
    }

    /// The faces of the box that a vertex lies in, as bits.
    [[nodiscard]] unsigned faces_of(std::uint32_t v) const;

    /// Whether the surface stays the same but for its shape if `from` moves to `to`, no triangle
    /// turns over or loses its area, and what lies in a face of the box stays there. False if there
    /// is no such edge. REQUIRES: `from` is not locked.
    bool is_allowed(std::uint32_t from, std::uint32_t to);
    /// REQUIRES: is_allowed().
    void collapse(std::uint32_t from, std::uint32_t to);

  private:
    [[nodiscard]] Double3 at(std::uint32_t v) const { return minus(patch_.point(v), origin_); }
    [[nodiscard]] Double3 normal(const PatchTriangle& t) const {
        return cross(minus(at(t[1]), at(t[0])), minus(at(t[2]), at(t[0])));
    }
    [[nodiscard]] int shared_triangles(std::uint32_t a, std::uint32_t b) const;
    [[nodiscard]] bool is_last_triangle(std::uint32_t from, std::uint32_t to) const;
    [[nodiscard]] bool joins_locked(std::uint32_t to) const;
    [[nodiscard]] bool stays_in_faces(std::uint32_t from, std::uint32_t to) const;
    [[nodiscard]] bool border_stays_in_face(std::uint32_t from, std::uint32_t to) const;
    [[nodiscard]] bool turns(std::uint32_t i, std::uint32_t from, std::uint32_t to) const;
    [[nodiscard]] bool is_double(std::uint32_t i, std::uint32_t from, std::uint32_t to) const;

    const Patch& patch_;
    const std::vector<bool>& locked_;
    Double3 origin_{};
    std::vector<PatchTriangle> triangles_;            ///< {0, 0, 0}: gone
    std::vector<std::vector<std::uint32_t>> around_;  ///< triangles of each vertex
    std::vector<std::uint32_t> near_;                 ///< neighbours of `from` that is asked about
    std::vector<std::uint32_t> far_;                  ///< of `to`
    std::vector<std::uint32_t> common_;               ///< of both
};

}  // namespace isonest::detail
