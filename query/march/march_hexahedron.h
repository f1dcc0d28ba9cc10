// Marching cubes with exact hits.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/march/cube_cases.h"
#include "query/march/part_vertices.h"
#include "query/values/topology.h"

namespace isonest::detail {

// Triangulates a polygon with the diagonals that have the smallest sum of lengths.
//
// Source: G. Klincsek, "Minimal triangulations of polygonal domains", Annals of Discrete
// Mathematics 9 (1980).

inline constexpr std::size_t kMaxPolygonCorners = 24;

/// Corners are 0 ... n - 1; each triangle has them in this order. `cost(i, j)`, i < j: of a
/// diagonal; infinite if it is forbidden. Calls triangle(i, j, k) for each triangle. Returns false,
/// without a call, if the polygon cannot be triangulated by the allowed diagonals. Ties are
/// resolved by n and the costs alone. REQUIRES: 3 <= n <= kMaxPolygonCorners.
template <class Cost, class AddTriangle>
bool triangulate_polygon(std::size_t n, const Cost& cost, const AddTriangle& triangle) {
    if (n == 3) {
        triangle(0U, 1U, 2U);
        return true;
    }
    constexpr double kForbidden = std::numeric_limits<double>::infinity();
    // For the part of the polygon between corners i and j: its diagonals except that one.
    std::array<std::array<double, kMaxPolygonCorners>, kMaxPolygonCorners> least;
    std::array<std::array<std::uint8_t, kMaxPolygonCorners>, kMaxPolygonCorners> apex;
    for (std::size_t i = 0; i + 1 < n; ++i) {
        least[i][i + 1] = 0;
    }
    for (std::size_t span = 2; span < n; ++span) {
        for (std::size_t i = 0; i + span < n; ++i) {
            const std::size_t j = i + span;
            least[i][j] = kForbidden;
            for (std::size_t k = i + 1; k < j; ++k) {
                double sum = least[i][k] + least[k][j];
                sum += k > i + 1 ? cost(i, k) : 0.0;
                sum += j > k + 1 ? cost(k, j) : 0.0;
                if (sum < least[i][j]) {
                    least[i][j] = sum;
                    apex[i][j] = static_cast<std::uint8_t>(k);
                }
            }
        }
    }
    if (!(least[0][n - 1] < kForbidden)) {
        return false;
    }
    std::array<std::array<std::uint8_t, 2>, kMaxPolygonCorners> open;
    std::size_t count = 0;
    open[count++] = {0, static_cast<std::uint8_t>(n - 1)};
    while (count > 0) {
        const auto [i, j] = open[--count];
        const std::uint8_t k = apex[i][j];
        triangle(i, k, j);
        if (k > i + 1) {
            open[count++] = {i, k};
        }
        if (j > k + 1) {
            open[count++] = {k, j};
        }
    }
    return true;
}

// A polygon of a hexahedral cell with some corners exactly at nodes.
//
// Sources: as cube_cases.h. Nodes exactly on the surface are treated as in local_mesh.cpp, with the
// sides of a cell's polygons instead of those of a tetrahedron's: the corners of a polygon on edges
// that meet in such a node are merged; polygons around the node that share sides form closed fans,
// and each fan is one vertex. If a polygon is left with two corners, it links the sheets on its two
// sides.

/// `Vertices`: PartVertices, or a type that makes vertices by the same names.
template <class Vertices>
class PolygonWithHits {
    static constexpr std::uint32_t kNoVertex = 0xFFFFFFFFU;

  public:
    /// Polygon `number` of a cell. `nodes`: bits of the corners that become one vertex per sheet if
    /// they lie on the surface; other corners do not count as on the surface.
    PolygonWithHits(Vertices& vertices, const Cube& cube, double iso, const HexahedronCase& c,
                    std::size_t number, unsigned nodes = 0xFF)
        : vertices_(vertices),
          cube_(cube),
          iso_(iso),
          edge_(c.edge.data() + c.first[number]),
          face_(c.face.data() + c.first[number]),
          size_(static_cast<std::size_t>(c.first[number + 1] - c.first[number])),
          nodes_(nodes),
          alone_(c.polygons == 1) {}

    /// Whether one of its corners lies at a node.
    [[nodiscard]] bool has_hits() const {
        for (std::size_t i = 0; i < size_; ++i) {
            if (is_hit(i)) {
                return true;
            }
        }
        return false;
    }
    void march(bool cut, std::vector<CollectedTriangle>& triangles) {
        std::size_t start = 0;
        while (start < size_ && stays_in_node(start + size_ - 1)) {
            ++start;
        }
        if (start == size_) {
            return;  // all corners are at one node
        }
        for (std::size_t i = start; i < start + size_; ++i) {
            Place place{i, i};
            while (stays_in_node(place.last)) {
                ++place.last;
            }
            i = place.last;
            add_place(place, cut, triangles);
        }
        march_places(0, cut, triangles);
    }

  private:
    /// Corners of the polygon, first to last, that lie at the same node; or one corner.
    struct Place {
        std::size_t first;
        std::size_t last;
    };
    struct Corner {
        std::uint32_t vertex;  ///< kNoVertex: use that of a run
        std::size_t run;
        unsigned faces;  ///< faces of the cell in which it lies (bits)
        bool own;        ///< no other polygon of the cell can have it
    };
    /// A side between two nodes that lie on the surface.
    struct Run {
        Int3 a;
        Int3 b;
        Int3 below;  ///< a node of the face that names the side
    };

    [[nodiscard]] const CubeEdge& edge(std::size_t i) const { return kCubeEdge[edge_[i % size_]]; }
    [[nodiscard]] unsigned above(std::size_t i) const {
        const CubeEdge& e = edge(i);
        return (cube_.below >> e.low & 1U) != 0 ? e.high : e.low;
    }
    [[nodiscard]] unsigned below(std::size_t i) const {
        return edge(i).low ^ edge(i).high ^ above(i);
    }
    [[nodiscard]] bool is_hit(std::size_t i) const {
        return cube_.value[above(i)] == iso_ && (nodes_ >> above(i) & 1U) != 0;
    }
    [[nodiscard]] Int3 node(unsigned corner) const { return cube_.low + corner_offset(corner); }
    /// Whether the side from corner i to the next has length 0.
    [[nodiscard]] bool stays_in_node(std::size_t i) const {
        return above(i) == above(i + 1) && is_hit(i);
    }
    /// Whether the surface may have a second side between the two nodes of the side from corner i:
    /// on an edge of the grid by any face at the edge, on the diagonal of a face if that face has
    /// both.
    [[nodiscard]] bool may_be_double(unsigned from, unsigned to, std::size_t i) const {
        const unsigned along = from ^ to;
        const unsigned other = from ^ to ^ below(i);
        return (along & (along - 1U)) == 0 || (cube_.below >> other & 1U) != 0;
    }
    /// Names a side at the node on the surface in which corner i lies: by the two nodes of its face
    /// that are not on the corner's edge, or by the one of them that is below.
    [[nodiscard]] Int3 side_name(std::size_t i, unsigned face) const {
        const unsigned along = above(i) ^ below(i);
        const unsigned across = 7U ^ along ^ (1U << (face / 2));
        return node(below(i)) + node(below(i) ^ across);
    }

    /// If the polygon returns to a node, the part since then becomes a separate polygon.
    void add_place(const Place& place, bool cut, std::vector<CollectedTriangle>& triangles) {
        for (std::size_t i = 0; i < places_; ++i) {
            Place& before = place_[i];
            if (is_hit(place.first) && above(before.first) == above(place.first)) {
                const std::size_t last = before.last;
                before.last = place.last;
                const Place kept = before;
                before = {place.first, last};
                alone_ = false;
                march_places(i, cut, triangles);
                place_[i] = kept;
                places_ = i + 1;
                return;
            }
        }
        place_[places_++] = place;
    }

    /// Processes the polygon of the places from `begin` on.
    void march_places(std::size_t begin, bool cut, std::vector<CollectedTriangle>& triangles) {
        count_ = 0;
        run_count_ = 0;
        for (std::size_t i = begin; i < places_; ++i) {
            add_corner(place_[i], place_[i + 1 < places_ ? i + 1 : begin]);
        }
        if (places_ - begin == 2) {
            vertices_.run_between(runs_[0].a, runs_[0].b, runs_[0].below, runs_[1].below);
            return;
        }
        for (std::size_t i = 0; i < count_; ++i) {
            if (corner_[i].vertex == kNoVertex) {
                const Run& run = runs_[corner_[i].run];
                corner_[i].vertex = vertices_.run(run.a, run.b, run.below);
            }
        }
        add_triangles(cut, triangles);
    }

    /// Also adds the middle of the side to the next corner, if that side lies between two nodes.
    void add_corner(const Place& place, const Place& next) {
        Corner& corner = corner_[count_++];
        if (!is_hit(place.first)) {
            corner = {vertices_.edge_of_cube(cube_, edge_[place.first % size_], iso_), 0,
                      faces_at(edge(place.first)), true};
            return;
        }
        const unsigned at = above(place.first);
        const std::uint32_t fan = vertices_.fan(
            node(at), side_name(place.first, face_[(place.first + size_ - 1) % size_]),
            side_name(place.last, face_[place.last % size_]));
        corner = {fan, 0, faces_at(at), false};
        const unsigned to = above(next.first);
        if (is_hit(next.first) && may_be_double(at, to, place.last)) {
            Corner& middle = corner_[count_++];
            middle = {kNoVertex, run_count_, corner.faces & faces_at(to), false};
            runs_[run_count_++] = {node(at), node(to),
                                   node(below(at < to ? place.last : next.first))};
        }
    }

    [[nodiscard]] double cost(std::size_t i, std::size_t j) const {
        const Corner& a = corner_[i];
        const Corner& b = corner_[j];
        if ((a.faces & b.faces) != 0 || !(a.own || b.own || alone_)) {
            return std::numeric_limits<double>::infinity();
        }
        const Double3& p = vertices_.position(a.vertex);
        const Double3& q = vertices_.position(b.vertex);
        double sum = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            sum += (p[axis] - q[axis]) * (p[axis] - q[axis]);
        }
        return sum;
    }

    void add_triangles(bool cut, std::vector<CollectedTriangle>& triangles) {
        const auto at = [&](std::size_t i) { return corner_[i].vertex; };
        // A diagonal within the cell from a corner that only this polygon has is also this
        // polygon's own.
        const bool done = triangulate_polygon(
            count_, [&](std::size_t i, std::size_t j) { return cost(i, j); },
            [&](std::size_t i, std::size_t j, std::size_t k) {
                triangles.push_back({{at(i), at(j), at(k)}, cut});
            });
        if (done) {
            return;
        }
        std::array<std::uint32_t, kMaxPolygonCorners> around{};
        for (std::size_t i = 0; i < count_; ++i) {
            around[i] = at(i);
        }
        const std::uint32_t centre = vertices_.centre(std::span(around.data(), count_));
        for (std::size_t i = 0; i < count_; ++i) {
            triangles.push_back({{centre, at(i), at((i + 1) % count_)}, cut});
        }
    }

    Vertices& vertices_;
    const Cube& cube_;
    double iso_;
    const std::uint8_t* edge_;
    const std::uint8_t* face_;
    std::size_t size_;
    unsigned nodes_;
    bool alone_;  ///< the cell has no other polygon
    // Elements beyond the counts are never read.
    std::array<Corner, kMaxPolygonCorners> corner_;
    std::size_t count_ = 0;
    std::array<Place, 12> place_;
    std::size_t places_ = 0;
    std::array<Run, kMaxPolygonCorners / 2> runs_;
    std::size_t run_count_ = 0;
};

/// Adds the surface's triangles in a hexahedral cell: a corner is inside if its value is not below
/// the isovalue; the triangles' normals point to smaller values. Where the surface passes exactly
/// through corners, there are no triangles of zero area and the mesh stays a manifold. `cut`: the
/// cell may extend beyond the box. `nodes`: as for PolygonWithHits. Returns false if the surface
/// does not pass through. REQUIRES: place() was called; the cube is not mirrored, its values are
/// finite.
bool march_hexahedron(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                      std::vector<CollectedTriangle>& triangles, unsigned nodes = 0xFF);

/// The same for a cell without a corner at the isovalue.
bool march_hexahedron_without_hits(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                                   std::vector<CollectedTriangle>& triangles);

// Marches one cell of an adaptive hexahedral grid. Its faces and edges may be shared with smaller
// cells.
//
// Sources: the rule on each face is that of cube_cases.h. A face beside smaller cells is marched
// like their faces, an edge beside them in halves, so that the polygons of the cells on both sides
// have the same sides. Compare R. Shekhar, E. Fayyad, R. Yagel, J. F. Cornhill, "Octree-based
// decimation of marching cubes surfaces", IEEE Visualization 1996, which moves the finer side
// instead.

/// A node's position is x + 3 y + 9 z, with coordinates in units of half an edge.
struct HexCell {
    Int3 low;               ///< node of the finest lattice
    std::int64_t edge = 1;  ///< length, in the finest lattice
    /// Bit p: the node exists. Corners always exist; midpoints of edges and centres of faces exist
    /// if smaller cells have them as corners; where the centre of a face exists, the midpoints of
    /// its edges do, too. REQUIRES: 0 elsewhere.
    std::uint32_t nodes = 0;
    std::array<double, 27> value{};  ///< of the existing nodes; finite
};

inline constexpr std::uint32_t kHexCorners =
    1U | 1U << 2U | 1U << 6U | 1U << 8U | 1U << 18U | 1U << 20U | 1U << 24U | 1U << 26U;

/// Adds the triangles of {value = iso} in the cell, with normals to smaller values. A node is
/// inside if its value is not below the isovalue; where it is equal, triangles of zero area may
/// arise. Returns false if there are none. REQUIRES: place() was not called.
bool march_hex_cell(PartVertices& vertices, const HexCell& cell, double iso, bool cut,
                    std::vector<CollectedTriangle>& triangles);

}  // namespace isonest::detail
