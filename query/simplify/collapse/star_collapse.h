// The collapse of an edge into one of its ends, as it is looked at before it is made: the triangles
// around the vertex that goes, and those that would take their place.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// A vertex, at the origin, with the ring around it, counterclockwise, and the corner that it
/// becomes, ring[0]. Old triangle i is (0, ring[i], ring[i + 1]), the last one (0, ring[n - 1],
/// ring[0]); new triangle j is (ring[0], ring[j], ring[j + 1]), 1 <= j <= n - 2.
struct Star {
    static constexpr std::size_t kMostCorners = 24;
    static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

    std::array<Double3, kMostCorners> ring;
    std::size_t corners = 0;  ///< n, >= 3
    /// At a border the old triangle that there is none of, 0 or n - 1; else kNone.
    std::size_t missing = kNone;
    /// At a border in a plane across one axis alone, in which both ends of the missing triangle's
    /// outer edge and the middle lie: that axis; else kNone.
    std::size_t axis = kNone;
    /// Whether a border goes through the middle in a straight line, but for rounding.
    bool is_straight = false;
};

/// Not thread-safe.
class StarCollapse {
  public:
    /// `positions`, `shared` and `locked` are of the patch's vertices, as in Patch. All but the box
    /// have to stay; positions may change as take_moved() says.
    StarCollapse(std::span<const std::array<float, 3>> positions, const PatchBox& box,
                 const std::vector<bool>& shared, const std::vector<bool>& locked,
                 CornerMesh& mesh);

    /// Whether there is such an edge, around which the surface stays the same but for its shape if
    /// `from` becomes `to`, and what lies in a face of the box stays there: borders and caps.
    /// REQUIRES: `from` is not locked.
    [[nodiscard]] bool look(std::uint32_t from, std::uint32_t to) {
        return look(from, to, CornerMesh::kNone);
    }
    /// The same at a border that goes from `from` to `to` and, on the other side, to `beyond`,
    /// where the edge from `to` to `beyond` is known to be one that nobody has.
    [[nodiscard]] bool look(std::uint32_t from, std::uint32_t to, std::uint32_t beyond);
    /// ring() is that of `from` from now on, and no collapse was looked at.
    void see(std::uint32_t from) { mesh_.ring_of(from, ring_); }
    /// The faces of the box that a vertex lies in, as bits.
    [[nodiscard]] unsigned faces_of(std::uint32_t v) const;
    using Normal = std::array<float, 3>;
    /// That of a triangle of the patch, of length 1, or 0.
    [[nodiscard]] const Normal& normal_of(std::uint32_t triangle) const {
        return normals_[triangle];
    }
    static Normal normal(const Double3& a, const Double3& b, const Double3& c);
    static float cosine(const Normal& a, const Normal& b);

    // After look() was true:

    [[nodiscard]] const Star& star() const { return star_; }
    /// The middle was moved by this, onto the straight line between its neighbours at a border.
    void slide(const Double3& by);
    /// How many triangles fewer there are after the collapse.
    [[nodiscard]] std::uint32_t fewer() const { return ring_.is_closed ? 2 : 1; }
    /// The vertices around `from`; after look() was false, too, where there is such an edge.
    [[nodiscard]] const CornerMesh::Ring& ring() const { return ring_; }
    /// Place in the patch of old triangle i; none of the missing one. New triangle j has that of
    /// old triangle j.
    [[nodiscard]] std::uint32_t triangle(std::size_t i) const { return half_[i] / 3; }
    /// The vertex of the patch at star().ring[i].
    [[nodiscard]] std::uint32_t vertex(std::size_t i) const {
        const std::size_t k = place_ + i;
        return ring_.vertices[k < star_.corners ? k : k - star_.corners];
    }
    /// New triangle j: vertices of the patch.
    [[nodiscard]] PatchTriangle after(std::size_t j) const {
        return {vertex(0), vertex(j), vertex(j + 1)};
    }

    /// Whether no new triangle is thin, below 5 degrees nearly, that is thinner than all before.
    [[nodiscard]] bool has_no_new_needle() const;
    /// Whether the sharpest of the edges of the star, those on its ring among them, is bent by no
    /// more than this after, or than before. False where a triangle that is not in the patch may
    /// lie across one of them. `least`: cosine of the angle between two normals.
    [[nodiscard]] bool has_no_new_fold(float least);
    /// A triangle's normal may not turn further than to this cosine by one collapse: 84 degrees.
    static constexpr float kLeastCosine = 0.1F;
    /// Whether all new triangles have an area, also in float32, and their normals are less than 84
    /// degrees from those of the old triangles in whose places they are. REQUIRES:
    /// has_no_new_fold() was asked.
    [[nodiscard]] bool turns_little() const;

    /// Makes the collapse: ring() is that of `to` then. REQUIRES: has_no_new_fold() was true.
    void take();
    /// The same where `to` has another position by now, which changes all triangles around it.
    void take_moved();

  private:
    [[nodiscard]] Double3 point(std::uint32_t v) const { return point_at(positions_[v]); }
    [[nodiscard]] bool stays_in_faces(std::uint32_t from, std::uint32_t to);
    void turn_ring();

    std::span<const std::array<float, 3>> positions_;
    PatchBox box_;
    const std::vector<bool>& shared_;
    const std::vector<bool>& locked_;
    CornerMesh& mesh_;
    std::vector<Normal> normals_;  ///< of the triangles
    CornerMesh::Ring ring_;
    std::size_t place_ = 0;  ///< in the ring, of what the middle becomes
    Star star_;
    std::array<std::uint32_t, Star::kMostCorners> half_{};  ///< from the middle
    std::array<Normal, Star::kMostCorners> turned_{};       ///< normals of the new triangles
};

}  // namespace isonest::detail
