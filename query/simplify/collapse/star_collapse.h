// The collapse of an edge into one of its ends, examined before it is made: the triangles around
// the vertex that is removed, and those that would replace them.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/simplify/block_grid.h"
#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/edge_queue.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// A vertex, at the origin, with the ring around it, counterclockwise, and the corner that it
/// becomes, ring[0]. Old triangle i is (0, ring[i], ring[i + 1]), the last one (0, ring[n - 1],
/// ring[0]); new triangle j is (ring[0], ring[j], ring[j + 1]), 1 <= j <= n - 2.
struct Star {
    static constexpr std::size_t kMaxCorners = 24;
    static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

    std::array<Double3, kMaxCorners> ring;
    std::size_t corners = 0;  ///< n, >= 3
    /// At a border, the old triangle that does not exist, 0 or n - 1; otherwise kNone.
    std::size_t missing = kNone;
    /// The axis of a plane across one axis that contains the border, that is, both ends of the
    /// missing triangle's outer edge and the middle; otherwise kNone.
    std::size_t axis = kNone;
    /// Whether a border goes through the middle in a straight line, apart from rounding.
    bool is_straight = false;
};

/// Not thread-safe.
class StarCollapse {
  public:
    /// `positions`, `shared` and `locked` are for the patch's vertices, as in Patch. All but the
    /// box must outlive this object; positions may change as described at take_moved().
    StarCollapse(std::span<const std::array<float, 3>> positions, const PatchBox& box,
                 const std::vector<bool>& shared, const std::vector<bool>& locked,
                 CornerMesh& mesh);

    /// Whether the edge exists, and `from` can become `to` without changing the topology, and with
    /// everything in a face of the box (borders and caps) staying there. REQUIRES: `from` is not
    /// locked.
    [[nodiscard]] bool look(std::uint32_t from, std::uint32_t to) {
        return look(from, to, CornerMesh::kNone);
    }
    /// The same at a border that goes from `from` to `to` and, on the other side, to `beyond`, if
    /// it is known that no edge from `to` to `beyond` exists elsewhere.
    [[nodiscard]] bool look(std::uint32_t from, std::uint32_t to, std::uint32_t beyond);
    /// Sets ring() to that of `from`, without examining a collapse.
    void see(std::uint32_t from) { mesh_.ring_of(from, ring_); }
    /// The faces of the box that contain a vertex, as bits.
    [[nodiscard]] unsigned faces_of(std::uint32_t v) const;
    using Normal = std::array<float, 3>;
    /// Normal of a triangle of the patch, of length 1, or 0.
    [[nodiscard]] const Normal& normal_of(std::uint32_t triangle) const {
        return normals_[triangle];
    }
    static Normal normal(const Double3& a, const Double3& b, const Double3& c);
    static float cosine(const Normal& a, const Normal& b);

    // After look() was true:

    [[nodiscard]] const Star& star() const { return star_; }
    /// Records that the middle was moved by this vector, onto the straight line between its
    /// neighbours at a border.
    void slide(const Double3& by);
    /// Number of triangles removed by the collapse.
    [[nodiscard]] std::uint32_t fewer() const { return ring_.is_closed ? 2 : 1; }
    /// The vertices around `from`; also valid after look() was false, if the edge exists.
    [[nodiscard]] const CornerMesh::Ring& ring() const { return ring_; }
    /// Index in the patch of old triangle i (not the missing one). New triangle j has the index of
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

    /// Whether no new triangle is thin (nearly below 5 degrees) and thinner than all before.
    [[nodiscard]] bool has_no_new_needle() const;
    /// Whether the sharpest edge of the star, including its ring, is bent by no more than this
    /// after the collapse, or no more than before. False if a triangle outside the patch may lie
    /// across one of these edges. `least`: cosine of the angle between two normals.
    [[nodiscard]] bool has_no_new_fold(float least);
    /// A triangle's normal may turn at most to this cosine by one collapse: 84 degrees.
    static constexpr float kMinCosine = 0.1F;
    /// Whether all new triangles have an area, also in float32, and their normals are less than 84
    /// degrees from those of the old triangles that they replace. REQUIRES: has_no_new_fold() was
    /// called.
    [[nodiscard]] bool turns_little() const;

    /// Performs the collapse; afterwards ring() is that of `to`. REQUIRES: has_no_new_fold() was
    /// true.
    void take();
    /// The same after `to` has got another position, which changes all triangles around it.
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
    std::size_t place_ = 0;  ///< in the ring, of the vertex that the middle becomes
    Star star_;
    std::array<std::uint32_t, Star::kMaxCorners> half_{};  ///< from the middle
    std::array<Normal, Star::kMaxCorners> turned_{};       ///< normals of the new triangles
};

// The collapse of an edge into a vertex that is not at one of its ends, examined before it is made.
//
// The vertices of the smallest mesh near a surface do not lie on that surface: where the surface is
// curved to one side, a mesh with its vertices on it is on the other side everywhere else. Source
// of the position: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics",
// SIGGRAPH 1997, "optimal placement".

/// Not thread-safe.
class PlacedCollapse {
  public:
    /// A triangle after the collapse.
    struct Placed {
        std::uint32_t triangle = 0;  ///< index in the patch
        PatchTriangle corners{};     ///< vertices of the patch
        Triangle at;
        StarCollapse::Normal normal{};
    };

    /// As for StarCollapse; all must outlive this object.
    PlacedCollapse(std::span<const std::array<float, 3>> positions, const PatchBox& box,
                   const std::vector<bool>& shared, const CornerMesh& mesh)
        : positions_(positions), box_(box), shared_(shared), mesh_(mesh) {}

    /// Whether the edge can be collapsed into its end at `place` (world coordinates): none of its
    /// ends and no other vertex in the box's faces is moved, nothing leaves the box, all triangles
    /// have an area, also in float32, and turn by less than 84 degrees. REQUIRES: the last
    /// `half`.look() was true for this edge, and its end is not locked.
    [[nodiscard]] bool look(const StarCollapse& half, const std::array<float, 3>& place);
    /// Whether the sharpest edge of the changed triangles is bent by no more than this after the
    /// collapse, or no more than before; as StarCollapse::has_no_new_fold(). REQUIRES: look() was
    /// true.
    [[nodiscard]] bool has_no_new_fold(const StarCollapse& half, float least) const;

    // After look() was true:

    [[nodiscard]] const std::array<float, 3>& place() const { return place_; }
    /// The triangles around both ends: indices in the patch.
    [[nodiscard]] std::span<const std::uint32_t> before() const { return before_; }
    /// The triangles that replace them, two fewer.
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

// Collapses the edges of a corner mesh one after another, independent of what the collapses must
// preserve.

/// Cosine of the angle between normals from which an edge counts as a fold where triangles are
/// measured: 120 degrees. With 72 degrees, 6 to 15 % more triangles are left, and hardly fewer
/// edges above 150 degrees.
inline constexpr float kMaxMeasuredFold = -0.5F;

/// Whether a collapse makes no new fold and turns no triangle far, so that it is worth measuring
/// what its triangles are near. REQUIRES: collapse.look() was true.
inline bool may_be_measured(StarCollapse& collapse) {
    return collapse.has_no_new_fold(kMaxMeasuredFold) && collapse.turns_little();
}

/// Whether none of the corners is locked.
inline bool is_free(const PatchTriangle& t, const std::vector<bool>& locked) {
    return std::none_of(t.begin(), t.end(), [&](std::uint32_t v) { return locked[v]; });
}

/// Due value of a collapse that is not made.
inline constexpr float kNever = std::numeric_limits<float>::infinity();

/// Number of removed triangles, by the bin (edge_queue.h) of the largest squared error until then.
using GoneTriangles = std::vector<std::uint64_t>;

inline void add_gone(GoneTriangles& to, const GoneTriangles& more) {
    to.resize(std::max(to.size(), more.size()));
    std::transform(more.begin(), more.end(), to.begin(), to.begin(), std::plus<>());
}

/// The limits that leave at most `most` of `triangles`, assuming that everything else is processed
/// as when these were removed. REQUIRES: within `limits` at most that many are left.
inline CollapseLimits up_to(const CollapseLimits& limits, const GoneTriangles& gone,
                            std::uint64_t triangles, std::uint64_t most) {
    std::size_t bin = 0;
    for (std::uint64_t left = triangles; left > most; ++bin) {
        left -= gone[bin];
    }
    return {limits.distance, std::min(limits.square_estimate, end_of_bin(bin - 1))};
}

/// The vertices of all triangles that must be kept, and those shared with other patches.
inline std::vector<bool> locked_vertices(const Patch& patch) {
    std::vector<bool> locked = patch.shared;
    for (std::size_t i = 0; i < patch.triangles.size(); ++i) {
        if (patch.stay[i] != Stay::no) {
            for (const std::uint32_t v : patch.triangles[i]) {
                locked[v] = true;
            }
        }
    }
    return locked;
}

/// For each vertex whether it is to be examined: it is not locked, and has a triangle that was not
/// tried.
inline std::vector<bool> waiting_vertices(std::span<const PatchTriangle> triangles,
                                          const std::vector<bool>& tried,
                                          const std::vector<bool>& locked) {
    std::vector<bool> waits(locked.size());
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        for (const std::uint32_t v : triangles[i]) {
            waits[v] = waits[v] || (!tried[i] && !locked[v]);
        }
    }
    return waits;
}

/// Collapses edges from the waiting vertices in the queue's order until none is left. due(edge)
/// examines an edge with `star` and returns the squared error at which it is due: kNever; now, if
/// that is hardly more than the edge's own error; or later, when it is called again. take()
/// performs the collapse and returns the number of removed triangles.
template <class Due, class Take>
GoneTriangles collapse_stars(EdgeQueue& queue, const StarCollapse& star,
                             const std::vector<bool>& waits, const std::vector<bool>& locked,
                             const Due& due, const Take& take) {
    constexpr std::size_t kNoWait = 8;  // bins by which it is not worth waiting
    for (std::uint32_t v = 0; v < waits.size(); ++v) {
        if (waits[v]) {
            queue.add(v);
        }
    }
    GoneTriangles gone;
    std::size_t largest = 0;
    while (const auto edge = queue.next()) {
        const float at = due(*edge);
        const bool is_now = at < kNever && bin_of(at) <= queue.bin() + kNoWait;
        if (!is_now) {
            queue.stays(*edge, star.ring());
            if (at < kNever) {
                queue.defer(*edge, at);
            }
            continue;
        }
        largest = std::max(largest, queue.bin());
        if (largest >= gone.size()) {
            gone.resize(largest + 1);
        }
        gone[largest] += take();
        queue.collapsed(edge->from, star.ring(), locked);
    }
    return gone;
}

// Whether a surface would pass over a node of the lattice when a vertex is collapsed.

/// Nodes that a surface must not pass over.
struct KeptNodes {
    /// Ensures that programs that round also find a node on its side.
    static constexpr double kMinMargin = 1e-3;

    WorldLattice lattice;
    /// Minimum distance of a surface from a node, as a multiple of the distance between nodes, in
    /// addition to rounding.
    double margin = kMinMargin;
};

/// The space between the triangles around a vertex and those that replace them is composed of the
/// tetrahedra that the old triangles span with the corner which the vertex becomes: their
/// boundaries add up to the new triangles minus the old ones. So the winding number around a node
/// in none of them does not change. Nodes closer to a tetrahedron than the margin count as inside
/// it. Thread-safety: constant data.
class NodesPassed {
  public:
    explicit NodesPassed(const KeptNodes& nodes) : lattice_(nodes.lattice), margin_(nodes.margin) {}

    /// Whether the collapse of `star` may pass over a node. Its middle is at `middle`, world
    /// coordinates, after it was moved by `slid`.
    [[nodiscard]] bool any(const Star& star, const Double3& middle, const Double3& slid) const;

  private:
    using Tetrahedron = std::array<Double3, 4>;
    [[nodiscard]] Double3 in_lattice(const Double3& world) const;
    [[nodiscard]] bool has_node(const Tetrahedron& t) const;

    WorldLattice lattice_;
    double margin_;
};

}  // namespace isonest::detail
