// A polygon of a hexahedral cell some of whose corners lie exactly in nodes.
//
// Sources: as hexahedron_cases.h. The treatment of nodes that lie exactly on the surface is that of
// local_mesh.cpp, with the sides of a cell's polygons in place of those of a tetrahedron's: the
// corners of a polygon on edges that meet in such a node become one; polygons around the node that
// share sides form closed fans, and each fan is one vertex. What is left of a polygon with two
// corners links the sheets on its two sides.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/march/finish_part.h"
#include "query/march/hexahedron_cases.h"
#include "query/march/part_vertices.h"
#include "query/march/triangulate_polygon.h"
#include "query/view/topology.h"

namespace isonest::detail {

/// `Vertices`: PartVertices, or what makes vertices by the same names.
template <class Vertices>
class PolygonWithHits {
    static constexpr std::uint32_t kNoVertex = 0xFFFFFFFFU;

  public:
    /// Polygon `number` of a cell. `nodes`: bits of the corners that become one vertex for each
    /// sheet if they lie on the surface; the others do not count as lying there.
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

    /// Whether one of its corners lies in a node.
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
            return;  // all around one node
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
    /// Corners of the polygon, first to last, that lie in one node or are one.
    struct Place {
        std::size_t first;
        std::size_t last;
    };
    struct Corner {
        std::uint32_t vertex;  ///< kNoVertex: that of a run
        std::size_t run;
        unsigned faces;  ///< of the cell in which it lies (bits)
        bool own;        ///< no other polygon of the cell can have it
    };
    /// A side between two nodes on the surface.
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
    /// Whether the side from corner i to the next has no length.
    [[nodiscard]] bool stays_in_node(std::size_t i) const {
        return above(i) == above(i + 1) && is_hit(i);
    }
    /// Whether the surface may have another side between the same two nodes, which are at the ends
    /// of the side from corner i: on an edge of the grid by any face at it, on the diagonal of a
    /// face if that face has both.
    [[nodiscard]] bool may_be_double(unsigned from, unsigned to, std::size_t i) const {
        const unsigned along = from ^ to;
        const unsigned other = from ^ to ^ below(i);
        return (along & (along - 1U)) == 0 || (cube_.below >> other & 1U) != 0;
    }
    /// Names a side at the node on the surface in which corner i lies: by the two nodes of its face
    /// that no edge of the corner's ends in, or that is the one below.
    [[nodiscard]] Int3 side_name(std::size_t i, unsigned face) const {
        const unsigned along = above(i) ^ below(i);
        const unsigned across = 7U ^ along ^ (1U << (face / 2));
        return node(below(i)) + node(below(i) ^ across);
    }

    /// Where the polygon comes to a node again, the part since then is a polygon by itself.
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

    /// The polygon of the places from `begin` on.
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

    /// With the middle of the side to the next one, if that lies between two nodes.
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
        // A diagonal within the cell from a corner that is this polygon's own is so as well.
        const bool done = triangulate_polygon(
            count_, [&](std::size_t i, std::size_t j) { return cost(i, j); },
            [&](std::size_t i, std::size_t j, std::size_t k) {
                triangles.push_back({{at(i), at(j), at(k)}, cut});
            });
        if (done) {
            return;
        }
        std::array<std::uint32_t, kMostPolygonCorners> around{};
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
    // What is beyond the counts is never read.
    std::array<Corner, kMostPolygonCorners> corner_;
    std::size_t count_ = 0;
    std::array<Place, 12> place_;
    std::size_t places_ = 0;
    std::array<Run, kMostPolygonCorners / 2> runs_;
    std::size_t run_count_ = 0;
};

}  // namespace isonest::detail
