// What the boundary of a solid has in one hexahedral cell at the faces of a closed box: the
// isosurface, and the caps in those faces.
//
// Source: as hexahedron_cases.h. A cap is what marching squares give in a face of the cell, with
// the rule of the surface's sides there. A cell that the box cuts is the smaller one that is left,
// with the values of the function that is trilinear in the whole cell.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "query/march/clip.h"
#include "query/march/cube_cases.h"
#include "query/march/finish_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

/// Cells at a face of the box have the same corners there, with the same values, and so the same
/// sides: the polygons of all cells, and the caps, close up. Where a corner has the isovalue it
/// counts as a little larger: there is a vertex on each edge from it to a smaller value, and
/// triangles may have zero area.
///
/// A vertex lies in a node, an edge, a face, or within a cell of the grid, and in faces of the box;
/// that is its name. Not thread-safe; one per thread, reused.
class CappedHexahedron {
  public:
    /// REQUIRES: box.close.
    explicit CappedHexahedron(const ClipBox& box) : box_(box), outside_(*box.close) {}

    /// Bits of the cell's corners that are in no cell which touches a face of the box.
    [[nodiscard]] unsigned corners_far_from_faces(const Cube& cube) const;

    /// Adds the cell's triangles: of the isosurface those that face smaller values, and the caps so
    /// that all of them face the same side of the solid. False if there are none. REQUIRES: the
    /// cell is not mirrored, its values are finite, a part of it is in the box, and it is of the
    /// finest lattice.
    bool march(PartVertices& vertices, const Cube& cube, double iso,
               std::vector<CollectedTriangle>& triangles);

  private:
    /// Of the cell within the box, along one axis.
    struct End {
        double at = 0;      ///< where it is, in the finest lattice
        double t = 0;       ///< from 0 to 1 in the whole cell
        bool cut = false;   ///< by the box, between the cell's nodes
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
    Cube cell_;  ///< what is left of it: sides and values of its corners
    std::array<std::uint32_t, 6> polygon_{};
    std::size_t size_ = 0;
};

}  // namespace isonest::detail
