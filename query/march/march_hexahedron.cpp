#include "query/march/march_hexahedron.h"

#include <limits>
#include <span>

#include "query/march/cube_cases.h"

namespace isonest::detail {
namespace {

/// Adds polygon `number` of a cell, as in the table.
void march_polygon(PartVertices& vertices, const Cube& cube, double iso, const HexahedronCase& c,
                   std::size_t number, bool cut, std::vector<CollectedTriangle>& triangles) {
    const std::size_t begin = c.first[number];
    const std::size_t end = c.first[number + 1];
    std::array<std::uint32_t, 12> v{};
    for (std::size_t i = begin; i < end; ++i) {
        v[i] = vertices.edge_of_cube(cube, c.edge[i], iso);
    }
    for (std::size_t i = begin - 2 * number; i < end - 2 * (number + 1); ++i) {
        const auto& t = c.triangle[i];
        triangles.push_back({{v[t[0]], v[t[1]], v[t[2]]}, cut});
    }
}

}  // namespace

bool march_hexahedron_without_hits(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                                   std::vector<CollectedTriangle>& triangles) {
    const HexahedronCase& c = hexahedron_cases()[cube.below];
    std::array<std::uint32_t, 12> v{};
    for (std::size_t i = 0; i < c.edges; ++i) {
        v[i] = vertices.edge_of_cube(cube, c.edge[i], iso);
    }
    for (std::size_t i = 0; i < c.triangles; ++i) {
        const auto& t = c.triangle[i];
        triangles.push_back({{v[t[0]], v[t[1]], v[t[2]]}, cut});
    }
    return c.triangles > 0;
}

bool march_hexahedron(PartVertices& vertices, const Cube& cube, double iso, bool cut,
                      std::vector<CollectedTriangle>& triangles, unsigned nodes) {
    const HexahedronCase& c = hexahedron_cases()[cube.below];
    for (std::size_t i = 0; i < c.polygons; ++i) {
        PolygonWithHits polygon(vertices, cube, iso, c, i, nodes);
        if (polygon.has_hits()) {
            polygon.march(cut, triangles);
        } else {
            march_polygon(vertices, cube, iso, c, i, cut, triangles);
        }
    }
    return c.triangles > 0;
}

namespace {

using Position = std::uint8_t;
constexpr std::array<int, 3> kStep{1, 3, 9};
constexpr Int3 kPositions{3, 3, 3};

/// An edge, or half of one, that the surface crosses.
struct Crossed {
    Position a;
    Position b;
    bool operator==(const Crossed&) const = default;
};

Crossed between(Position a, Position b) {
    return a < b ? Crossed{a, b} : Crossed{b, a};
}

/// Bits of the cell's faces that contain a node: 2 axis + (0 low, 1 high).
unsigned faces_with(Position p) {
    unsigned faces = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const int at = p / kStep[axis] % 3;
        faces |= at == 1 ? 0U : 1U << (2 * axis + (at == 2 ? 1U : 0U));
    }
    return faces;
}

class CellSurface {
  public:
    CellSurface(PartVertices& vertices, const HexCell& cell, double iso)
        : vertices_(vertices), cell_(cell), iso_(iso) {
        for (std::size_t p = 0; p < 27; ++p) {
            below_ |= (has(static_cast<Position>(p)) && cell.value[p] < iso ? 1U : 0U) << p;
        }
    }

    bool march(bool cut, std::vector<CollectedTriangle>& triangles) {
        if (below_ == 0 || below_ == cell_.nodes) {
            return false;
        }
        for (unsigned face = 0; face < 6; ++face) {
            add_face(face);
        }
        for (std::size_t start = 0; start < sides_; ++start) {
            if (done_[start]) {
                continue;
            }
            corners_ = 0;
            for (std::size_t at = start; !done_[at]; at = after(at)) {
                done_[at] = true;
                polygon_[corners_++] = from_[at];
            }
            add_polygon(cut, triangles);
        }
        return true;
    }

  private:
    static constexpr std::size_t kMaxSides = 64;

    [[nodiscard]] bool has(Position p) const { return (cell_.nodes >> p & 1U) != 0; }
    [[nodiscard]] bool is_below(Position p) const { return (below_ >> p & 1U) != 0; }
    [[nodiscard]] Int3 node(Position p) const {
        const Int3 o = kPositions.unlinear(p);
        const Int3 twice = o * cell_.edge;
        return cell_.low + Int3{twice.x / 2, twice.y / 2, twice.z / 2};
    }

    void add_face(unsigned face) {
        const unsigned axis = face / 2;
        const bool high = (face & 1U) != 0;
        const int u = kStep[(axis + (high ? 1 : 2)) % 3];
        const int v = kStep[(axis + (high ? 2 : 1)) % 3];
        const int base = high ? 2 * kStep[axis] : 0;
        const auto at = [&](int i, int j) { return static_cast<Position>(base + i * u + j * v); };
        if (has(at(1, 1))) {
            for (int i = 0; i < 2; ++i) {
                for (int j = 0; j < 2; ++j) {
                    add_sides(std::array{at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
                }
            }
            return;
        }
        std::array<Position, 8> around{};
        std::size_t count = 0;
        for (const Position p :
             {at(0, 0), at(1, 0), at(2, 0), at(2, 1), at(2, 2), at(1, 2), at(0, 2), at(0, 1)}) {
            if (has(p)) {
                around[count++] = p;
            }
        }
        add_sides(std::span(around.data(), count));
    }

    /// Going counterclockwise around a face, each run of nodes below is cut off by a side.
    void add_sides(std::span<const Position> around) {
        const std::size_t n = around.size();
        for (std::size_t first = 0; first < n; ++first) {
            const Position before = around[(first + n - 1) % n];
            if (!is_below(around[first]) || is_below(before)) {
                continue;
            }
            std::size_t last = first;
            while (is_below(around[(last + 1) % n])) {
                ++last;
            }
            from_[sides_] = between(around[last % n], around[(last + 1) % n]);
            to_[sides_] = between(before, around[first]);
            done_[sides_++] = false;
        }
    }

    [[nodiscard]] std::size_t after(std::size_t side) const {
        std::size_t next = 0;
        while (!(from_[next] == to_[side])) {
            ++next;
        }
        return next;
    }

    void add_polygon(bool cut, std::vector<CollectedTriangle>& triangles) {
        std::array<std::uint32_t, kMaxSides> v{};
        for (std::size_t i = 0; i < corners_; ++i) {
            const auto [a, b] = polygon_[i];
            v[i] = vertices_.edge(node(a), cell_.value[a], node(b), cell_.value[b], iso_);
        }
        const auto cost = [&](std::size_t i, std::size_t j) {
            const unsigned faces = faces_with(polygon_[i].a) & faces_with(polygon_[i].b) &
                                   faces_with(polygon_[j].a) & faces_with(polygon_[j].b);
            if (faces != 0) {
                return std::numeric_limits<double>::infinity();
            }
            const Double3& p = vertices_.position(v[i]);
            const Double3& q = vertices_.position(v[j]);
            double sum = 0;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                sum += (p[axis] - q[axis]) * (p[axis] - q[axis]);
            }
            return sum;
        };
        if (corners_ <= kMaxPolygonCorners &&
            triangulate_polygon(corners_, cost, [&](std::size_t i, std::size_t j, std::size_t k) {
                triangles.push_back({{v[i], v[j], v[k]}, cut});
            })) {
            return;
        }
        const std::uint32_t centre =
            vertices_.centre(std::span<const std::uint32_t>(v.data(), corners_));
        for (std::size_t i = 0; i < corners_; ++i) {
            triangles.push_back({{centre, v[i], v[(i + 1) % corners_]}, cut});
        }
    }

    PartVertices& vertices_;
    const HexCell& cell_;
    double iso_;
    std::uint32_t below_ = 0;
    // Elements beyond the counts are never read.
    std::array<Crossed, kMaxSides> from_;
    std::array<Crossed, kMaxSides> to_;
    std::array<bool, kMaxSides> done_;
    std::size_t sides_ = 0;
    std::array<Crossed, kMaxSides> polygon_;
    std::size_t corners_ = 0;
};

}  // namespace

bool march_hex_cell(PartVertices& vertices, const HexCell& cell, double iso, bool cut,
                    std::vector<CollectedTriangle>& triangles) {
    return CellSurface(vertices, cell, iso).march(cut, triangles);
}

}  // namespace isonest::detail
