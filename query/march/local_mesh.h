// The part of the surface that one thread makes at a time, before vertices are welded across parts.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/int3.h>

#include "query/march/capped_cells.h"
#include "query/march/march_hexahedron.h"
#include "query/march/mesh_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

/// Collects triangles of marched tetrahedra. Not thread-safe; one per thread, reused.
class LocalMesh {
  public:
    /// `attributes`: of the vertices; must outlive the mesh. `finest`: as for PartVertices.
    /// `single_sheet`: the surface never touches itself (a plane), so a node on it is one vertex,
    /// and a face in it one triangle.
    explicit LocalMesh(AttributeSampler* attributes, bool single_sheet = false,
                       FinestCrossing* finest = nullptr)
        : single_sheet_(single_sheet), vertices_(attributes, finest) {}
    /// For a surface closed at the faces of `box`. Where it passes exactly through nodes near the
    /// faces, it has a vertex on each edge to a smaller value, and triangles may have zero area.
    /// REQUIRES: box.close.
    LocalMesh(AttributeSampler* attributes, const ClipBox& box)
        : caps_(box), cell_caps_(box), vertices_(attributes) {}

    /// From now on all corners are nodes of the lattice of edge 2^level, in the box of `cells`
    /// starting at node `low`; this speeds up finding vertices. REQUIRES: empty().
    void place(const Int3& low, int level, const Int3& cells) {
        vertices_.place(low, level, cells);
    }

    /// Marches one leaf tetrahedron: a node is inside if value >= iso; the triangles' normals point
    /// to smaller values. Where the surface passes exactly through nodes, there are no triangles of
    /// zero area and the mesh stays a manifold. `cut`: the tetrahedron may extend beyond the box,
    /// or touch the faces of a closed box. `positive`: det(v1 - v0, v2 - v0, v3 - v0) > 0.
    void march(const std::array<Corner, 4>& corners, bool positive, double iso, bool cut);

    /// Marches the six tetrahedra of a cube and returns how many of them the surface crosses.
    /// REQUIRES: place() was called; no corner has the isovalue, and the cube touches no face of a
    /// closed box.
    unsigned march_cube(const Cube& cube, double iso, bool cut);
    /// Marches one of them (kAxisOrders). REQUIRES: as above, for its own corners.
    unsigned march_in_cube(const Cube& cube, std::size_t order, double iso, bool cut);

    /// Marches a hexahedral cell (march_hexahedron.h). `hits`: whether a corner has the isovalue.
    /// `cut`: as for march(). REQUIRES: as there; if the mesh is closed, a cell of the finest
    /// lattice.
    bool march_hexahedron(const Cube& cube, bool hits, double iso, bool cut);

    /// Marches a cell of an adaptive hexahedral grid (march_hexahedron.h). REQUIRES: place() was
    /// not called, and the mesh is not closed.
    bool march_hex_cell(const HexCell& cell, double iso, bool cut) {
        return detail::march_hex_cell(vertices_, cell, iso, cut, triangles_);
    }

    /// Adds the line {U = iso} in a leaf triangle of a plane, if any: a "triangle" whose last two
    /// corners are equal. A mesh contains either lines or triangles.
    void march_line(const std::array<Corner, 3>& corners, double iso, bool cut);
    /// Adds a leaf triangle of the graph z = U over the xy plane, facing up.
    void add_graph(const std::array<Corner, 3>& corners, bool cut);

    [[nodiscard]] bool empty() const { return triangles_.empty() && vertices_.size() == 0; }
    /// Current size, in units of a vertex; the owner limits it by finishing the part.
    [[nodiscard]] std::size_t size() const { return vertices_.weight(); }
    /// Maximum bytes of heap per unit of size(), including finish(); the table of place() is
    /// additional.
    static constexpr std::size_t kBytesPerVertex = 488;

    /// Converts the collected triangles to a part, clipped to the box, and starts a new one.
    MeshPart finish(const ClipBox& box);

  private:
    std::uint32_t edge_vertex(const Corner& a, const Corner& b, double iso) {
        return vertices_.edge(a.node, a.value, b.node, b.value, iso);
    }
    std::uint32_t fan(const Corner& node, const Corner& a0, const Corner& b0, const Corner& a1,
                      const Corner& b1);
    void add(std::uint32_t a, std::uint32_t b, std::uint32_t c, bool cut) {
        triangles_.push_back({{a, b, c}, cut});
    }
    void add_split(const std::array<std::uint32_t, 3>& v, const std::array<std::uint32_t, 3>& mid,
                   bool cut);
    void march_one_below(const Corner& q, const std::array<const Corner*, 3>& above, bool positive,
                         double iso, bool cut);
    void march_two_below(const Corner& a, const Corner& b, const Corner& q1, const Corner& q2,
                         bool positive, double iso, bool cut);

    /// Whether a node on the surface has its own vertices. Otherwise, near the faces of a closed
    /// box, the edges to it have vertices.
    [[nodiscard]] bool is_hit(const Corner& c, double iso) const {
        return c.value == iso && (!caps_ || caps_->is_far_from_faces(vertices_.finest(c.node)));
    }

    bool single_sheet_ = false;
    // Set if a box is closed.
    std::optional<CappedTetrahedron> caps_;
    std::optional<CappedHexahedron> cell_caps_;
    bool lines_ = false;
    PartVertices vertices_;
    std::vector<CollectedTriangle> triangles_;
};

}  // namespace isonest::detail
