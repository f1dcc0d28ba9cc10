// What the boundary of a solid has in one leaf tetrahedron: the isosurface, and the caps in the
// faces of the box at which the surface is closed.
//
// Source: a convex polytope is cut by one half-space after the other, as in I. Sutherland, G.
// Hodgman, "Reentrant polygon clipping", CACM 17 (1974), with all its facets at once. What decides
// are combinatorics and, where an element lies in a plane, integers, in the manner of H.
// Edelsbrunner, E. P. Muecke, "Simulation of simplicity", ACM Trans. Graphics 9 (1990): a value
// that is the isovalue counts as a little larger, and the box as smaller by much less than that.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>
#include <isonest/world.h>

#include "query/march/clip.h"
#include "query/march/corner.h"
#include "query/march/finish_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

/// The solid in a tetrahedron is the tetrahedron cut by the isovalue and by the box, a convex
/// polytope. Its facets but those in the tetrahedron's own faces make the mesh. Both tetrahedra at
/// a face cut that face alike, by the same numbers, so that the facets of all tetrahedra close up,
/// whatever is rounded.
///
/// A vertex lies in a node, an edge, a triangle of the grid, or within the tetrahedron, and in
/// faces of the box; that is its name. Where a node, or an edge at the isovalue, lies in a face of
/// the box, what is cut off at it is nothing but the place itself: there is one vertex, not one for
/// each cut. Not thread-safe; one per thread, reused.
class CappedTetrahedron {
  public:
    /// REQUIRES: box.close.
    explicit CappedTetrahedron(const ClipBox& box) : box_(box), outside_(*box.close) {}

    /// Whether the box's faces cut or touch a tetrahedron with these corners.
    [[nodiscard]] bool touches(const PartVertices& vertices, const std::array<Corner, 4>& corners);

    /// Whether no leaf with this node (of the finest lattice) as a corner can touch the faces: a
    /// pure function of the node. Elements at a node of scale s reach no further than 2 s.
    [[nodiscard]] bool is_far_from_faces(const Int3& node) const;

    /// Adds the tetrahedron's triangles: of the isosurface those that face smaller values, and the
    /// caps so that all of them face the same side of the solid. `positive`: as in
    /// LocalMesh::march(). REQUIRES: touches() was just called for the corners.
    void march(PartVertices& vertices, const std::array<Corner, 4>& corners, bool positive,
               double iso, std::vector<CollectedTriangle>& triangles);

  private:
    static constexpr std::uint32_t kNone = 0xFFFFFFFFU;
    /// Bits of Vertex::cuts: the six faces of the box, and the isovalue.
    static constexpr std::uint32_t kPlanes = 6;
    static constexpr std::uint32_t kIso = 6;

    struct Vertex {
        Double3 position{};
        unsigned nodes = 0;      ///< bits of the corners between which it lies
        std::uint32_t cuts = 0;  ///< bits of what made it
        std::uint32_t last = 0;  ///< the last of them
        std::uint32_t from = 0;  ///< it lies at from + t (to - from); of an edge in OnEdge's order
        std::uint32_t to = 0;
        double t = 0;
        std::uint32_t same = 0;  ///< the vertex in whose place it lies; itself, mostly
        std::uint32_t number = kNone;
    };
    /// A cycle of vertices, counterclockwise seen from outside: corners_[begin, end).
    struct Facet {
        std::uint32_t cut;  ///< which made it; kNone for the tetrahedron's own faces
        std::size_t begin;
        std::size_t end;
    };
    /// Where an edge of the polytope leaves a half-space.
    struct Crossing {
        std::uint32_t inside;
        std::uint32_t outside;
        std::uint32_t vertex;
        std::uint32_t next = kNone;  ///< the vertex after it in the new facet
    };
    enum class Side : std::uint8_t { inside, on, outside };

    void begin(const PartVertices& vertices, const std::array<Corner, 4>& corners, bool positive);
    void cut_at_iso(const PartVertices& vertices, const std::array<Corner, 4>& corners, double iso);
    void cut_at_plane(std::uint32_t plane);
    template <class Make>
    void cut(std::uint32_t by, const Make& make);
    [[nodiscard]] Side side_of(const Vertex& v, std::uint32_t plane) const;
    [[nodiscard]] Vertex on_plane(std::uint32_t inside, std::uint32_t outside,
                                  std::uint32_t plane) const;
    std::uint32_t number_of(PartVertices& vertices, const std::array<Corner, 4>& corners,
                            double iso, std::uint32_t v);
    [[nodiscard]] double limit(std::uint32_t plane) const {
        return (plane & 1U) == 0 ? box_.lo[plane / 2] : box_.hi[plane / 2];
    }

    ClipBox box_;
    Outside outside_;
    /// Bits of the corners on the inner side of each face of the box, and on its outer side.
    std::array<unsigned, kPlanes> inner_{};
    std::array<unsigned, kPlanes> outer_{};
    std::vector<Vertex> vertices_;
    std::vector<Side> sides_;  ///< of the vertices, for the present cut
    std::vector<Facet> facets_;
    std::vector<std::uint32_t> corners_;
    std::vector<Facet> cut_facets_;  ///< what is left of them after the present cut
    std::vector<std::uint32_t> cut_corners_;
    std::vector<Crossing> crossings_;
    std::vector<std::uint32_t> polygon_;
};

}  // namespace isonest::detail
