// The boundary of a solid within one cell, at the faces of a closed box.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>
#include <isonest/world.h>

#include "query/march/clip.h"
#include "query/march/cube_cases.h"
#include "query/march/mesh_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

// The boundary of a solid within one leaf tetrahedron: the isosurface, and the caps in the faces of
// the box at which the surface is closed.
//
// Source: a convex polytope is cut by one half-space after another, as in I. Sutherland, G.
// Hodgman, "Reentrant polygon clipping", CACM 17 (1974), with all its facets at once. Decisions use
// combinatorics and, where an element lies in a plane, integers, in the manner of H. Edelsbrunner,
// E. P. Muecke, "Simulation of simplicity", ACM Trans. Graphics 9 (1990): a value equal to the
// isovalue counts as slightly larger, and the box as smaller by much less than that.

/// The solid in a tetrahedron is the tetrahedron cut by the isovalue and by the box: a convex
/// polytope. All its facets except those in the tetrahedron's own faces make the mesh. Both
/// tetrahedra at a face cut it identically, from the same numbers, so the facets of all tetrahedra
/// close up regardless of rounding.
///
/// A vertex is identified by the node, edge, triangle of the grid or tetrahedron in which it lies,
/// and by the faces of the box in which it lies. If a node, or an edge at the isovalue, lies in a
/// face of the box, the part cut off there is only that place: there is one vertex, not one for
/// each cut. Not thread-safe; one per thread, reused.
class CappedTetrahedron {
  public:
    /// REQUIRES: box.close.
    explicit CappedTetrahedron(const ClipBox& box) : box_(box), outside_(*box.close) {}

    /// Whether the box's faces cut or touch a tetrahedron with these corners.
    [[nodiscard]] bool touches(const PartVertices& vertices, const std::array<Corner, 4>& corners);

    /// Whether no leaf with this node (of the finest lattice) as a corner can touch the faces;
    /// depends only on the node. Elements at a node of scale s extend at most 2 s from it.
    [[nodiscard]] bool is_far_from_faces(const Int3& node) const;

    /// Adds the tetrahedron's triangles: those of the isosurface face smaller values, and caps are
    /// oriented so that all triangles face the same side of the solid. `positive`: as in
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
        std::uint32_t cuts = 0;  ///< bits of the planes that made it
        std::uint32_t last = 0;  ///< the last of them
        std::uint32_t from = 0;  ///< position: from + t (to - from); on an edge, in OnEdge's order
        std::uint32_t to = 0;
        double t = 0;
        std::uint32_t same = 0;  ///< the vertex at the same place; usually itself
        std::uint32_t number = kNone;
    };
    /// A cycle of vertices, counterclockwise seen from outside: corners_[begin, end).
    struct Facet {
        std::uint32_t cut;  ///< the plane that made it; kNone for the tetrahedron's own faces
        std::size_t begin;
        std::size_t end;
    };
    /// A point where an edge of the polytope leaves a half-space.
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
    /// Bits of the corners on the inner and on the outer side of each face of the box.
    std::array<unsigned, kPlanes> inner_{};
    std::array<unsigned, kPlanes> outer_{};
    std::vector<Vertex> vertices_;
    std::vector<Side> sides_;  ///< of the vertices, for the current cut
    std::vector<Facet> facets_;
    std::vector<std::uint32_t> corners_;
    std::vector<Facet> cut_facets_;  ///< what is left of them after the current cut
    std::vector<std::uint32_t> cut_corners_;
    std::vector<Crossing> crossings_;
    std::vector<std::uint32_t> polygon_;
};

// The boundary of a solid within one hexahedral cell, at the faces of a closed box: the isosurface,
// and the caps in those faces.
//
// Source: as cube_cases.h. A cap is the result of marching squares in a face of the cell, with the
// same rule as for the sides of the surface there. A cell cut by the box is replaced by its smaller
// part, with the values of the function that is trilinear in the whole cell.

/// Cells at a face of the box have the same corners there, with the same values, and so the same
/// sides: the polygons of all cells, and the caps, close up. A corner with the isovalue counts as
/// slightly larger: there is a vertex on each edge from it to a smaller value, and triangles may
/// have zero area.
///
/// A vertex is identified by the node, edge, face or cell of the grid in which it lies, and by the
/// faces of the box in which it lies. Not thread-safe; one per thread, reused.
class CappedHexahedron {
  public:
    /// REQUIRES: box.close.
    explicit CappedHexahedron(const ClipBox& box) : box_(box), outside_(*box.close) {}

    /// Bits of the corners that belong to no cell touching a face of the box.
    [[nodiscard]] unsigned corners_far_from_faces(const Cube& cube) const;

    /// Adds the cell's triangles: those of the isosurface face smaller values, and caps are
    /// oriented so that all triangles face the same side of the solid. Returns false if there are
    /// none. REQUIRES: the cell is not mirrored, its values are finite, a part of it is in the box,
    /// and it is of the finest lattice.
    bool march(PartVertices& vertices, const Cube& cube, double iso,
               std::vector<CollectedTriangle>& triangles);

  private:
    /// One end of the cell within the box, along one axis.
    struct End {
        double at = 0;      ///< coordinate in the finest lattice
        double t = 0;       ///< from 0 to 1 in the whole cell
        bool cut = false;   ///< cut by the box between the cell's nodes
        bool face = false;  ///< it is a face of the box
    };

    void cut_cell(const Cube& cube);
    [[nodiscard]] const End& end(unsigned corner, unsigned axis) const {
        return ends_[axis][corner >> axis & 1U];
    }
    [[nodiscard]] unsigned planes_at(unsigned corner) const;
    [[nodiscard]] Double3 position_of(unsigned corner) const;
    [[nodiscard]] Int3 twice(unsigned corner) const;
    [[nodiscard]] VertexAttributes attributes_of(AttributeSampler& sampler, unsigned corner) const;
    std::uint32_t corner_vertex(PartVertices& vertices, unsigned corner) const;
    std::uint32_t edge_vertex(PartVertices& vertices, std::size_t edge, double iso) const;
    void add_caps(PartVertices& vertices, unsigned face, double iso,
                  std::vector<CollectedTriangle>& triangles);
    void add_cap(const PartVertices& vertices, std::vector<CollectedTriangle>& triangles) const;

    ClipBox box_;
    Outside outside_;
    std::array<std::array<End, 2>, 3> ends_{};
    Cube cell_;  ///< the part that is left: sides and values of its corners
    std::array<std::uint32_t, 6> polygon_{};
    std::size_t size_ = 0;
};

}  // namespace isonest::detail
