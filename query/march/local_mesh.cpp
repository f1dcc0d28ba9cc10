// Marching tetrahedra with exact hits.
//
// Sources: A. Doi, A. Koide, "An efficient method of triangulating equi-valued surfaces by using
// tetrahedral cells", IEICE Trans. E74 (1991) for the cases. The treatment of nodes exactly on the
// surface is our own: a tetrahedron face with such a node, one node below and one not below is
// crossed by the surface in a segment from that node; the faces around a node that successive
// tetrahedra link form closed fans, and each fan is one vertex. So sheets that touch at a node stay
// separate, and triangles without area never arise.
#include "query/march/local_mesh.h"

#include "query/march/cube_cases.h"
#include "query/march/march_hexahedron.h"
#include "query/values/topology.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNoMidpoint = 0xFFFFFFFFU;

}  // namespace

/// The fan at `node` that enters this tetrahedron through the face (node, a0, b0) and leaves it
/// through (node, a1, b1).
std::uint32_t LocalMesh::fan(const Corner& node, const Corner& a0, const Corner& b0,
                             const Corner& a1, const Corner& b1) {
    if (single_sheet_) {
        return vertices_.node(node.node);
    }
    return vertices_.fan(node.node, a0.node + b0.node, a1.node + b1.node);
}

/// Adds a triangle whose edge i, from corner i to i + 1, passes through mid[i] if that is a vertex:
/// none of them, one, or all three.
void LocalMesh::add_split(const std::array<std::uint32_t, 3>& v,
                          const std::array<std::uint32_t, 3>& mid, bool cut) {
    const int count = (mid[0] != kNoMidpoint) + (mid[1] != kNoMidpoint) + (mid[2] != kNoMidpoint);
    if (count == 0) {
        return add(v[0], v[1], v[2], cut);
    }
    if (count == 1) {
        const std::size_t s = mid[0] != kNoMidpoint ? 0 : mid[1] != kNoMidpoint ? 1 : 2;
        add(v[s], mid[s], v[(s + 2) % 3], cut);
        return add(mid[s], v[(s + 1) % 3], v[(s + 2) % 3], cut);
    }
    // The whole triangle is a face of the grid, and the surface may pass through it on both sides
    // with the same six vertices; a separate centre distinguishes the two.
    const std::uint32_t c = vertices_.centre(v);
    for (std::size_t i = 0; i < 3; ++i) {
        add(c, v[i], mid[i], cut);
        add(c, mid[i], v[(i + 1) % 3], cut);
    }
}

void LocalMesh::march_one_below(const Corner& q, const std::array<const Corner*, 3>& above,
                                bool positive, double iso, bool cut) {
    // (q, above) positive: the triangle above0, above1, above2 faces away from q.
    const std::array<std::size_t, 3> order =
        positive ? std::array<std::size_t, 3>{0, 2, 1} : std::array<std::size_t, 3>{0, 1, 2};
    std::array<std::uint32_t, 3> v{};
    std::array<std::uint32_t, 3> mid{kNoMidpoint, kNoMidpoint, kNoMidpoint};
    for (std::size_t i = 0; i < 3; ++i) {
        const Corner& a = *above[order[i]];
        const Corner& b = *above[order[(i + 1) % 3]];
        const Corner& c = *above[order[(i + 2) % 3]];
        v[i] = is_hit(a, iso) ? fan(a, b, q, c, q) : edge_vertex(a, q, iso);
        if (!single_sheet_ && is_hit(a, iso) && is_hit(b, iso)) {
            mid[i] = vertices_.run(a.node, b.node, q.node);
        }
    }
    add_split(v, mid, cut);
}

void LocalMesh::march_two_below(const Corner& a, const Corner& b, const Corner& q1,
                                const Corner& q2, bool positive, double iso, bool cut) {
    const bool a_hit = is_hit(a, iso);
    const bool b_hit = is_hit(b, iso);
    if (a_hit && b_hit) {
        if (single_sheet_) {
            return;  // everything else there comes from other tetrahedra
        }
        fan(a, b, q1, b, q2);
        fan(b, a, q1, a, q2);
        vertices_.run_between(a.node, b.node, q1.node, q2.node);
        return;
    }
    // (a, b, q1, q2) positive: the quadrilateral a q1, a q2, b q2, b q1 faces q.
    const Corner& r1 = positive ? q1 : q2;
    const Corner& r2 = positive ? q2 : q1;
    if (a_hit) {
        const std::uint32_t at = fan(a, b, q1, b, q2);
        const std::uint32_t v2 = edge_vertex(b, r2, iso);
        return add(at, v2, edge_vertex(b, r1, iso), cut);
    }
    if (b_hit) {
        const std::uint32_t at = fan(b, a, q1, a, q2);
        const std::uint32_t v1 = edge_vertex(a, r1, iso);
        return add(v1, edge_vertex(a, r2, iso), at, cut);
    }
    const std::uint32_t a1 = edge_vertex(a, r1, iso);
    const std::uint32_t a2 = edge_vertex(a, r2, iso);
    const std::uint32_t b2 = edge_vertex(b, r2, iso);
    const std::uint32_t b1 = edge_vertex(b, r1, iso);
    add(a1, a2, b2, cut);
    add(a1, b2, b1, cut);
}

void LocalMesh::march(const std::array<Corner, 4>& corners, bool positive, double iso, bool cut) {
    if (cut && caps_) {
        if (caps_->touches(vertices_, corners)) {
            return caps_->march(vertices_, corners, positive, iso, triangles_);
        }
        cut = false;
    }
    unsigned mask = 0;
    for (unsigned i = 0; i < 4; ++i) {
        mask |= corners[i].value < iso ? 1U << i : 0U;
    }
    const Crossing& crossing = kCrossings[mask];
    const auto at = [&](std::size_t i) -> const Corner& { return corners[crossing.order[i]]; };
    const bool outward = positive != crossing.flip;
    if (crossing.below == 1) {
        march_one_below(at(0), {&at(1), &at(2), &at(3)}, outward, iso, cut);
    } else if (crossing.below == 2) {
        march_two_below(at(0), at(1), at(2), at(3), outward, iso, cut);
    } else if (crossing.below == 3 && !is_hit(at(0), iso)) {
        const std::uint32_t v0 = edge_vertex(at(0), at(1), iso);
        const std::uint32_t v1 = edge_vertex(at(0), at(outward ? 2 : 3), iso);
        add(v0, v1, edge_vertex(at(0), at(outward ? 3 : 2), iso), cut);
    }
}

unsigned LocalMesh::march_cube(const Cube& cube, double iso, bool cut) {
    const CubeCase& c = cube_cases(is_mirror_image(cube.mirror))[cube.below];
    std::array<std::uint32_t, kCubeEdges> v{};
    for (std::size_t i = 0; i < c.edges; ++i) {
        v[c.edge[i]] = vertices_.edge_of_cube(cube, c.edge[i], iso);
    }
    for (std::size_t i = 0; i < c.first[6]; ++i) {
        const auto& t = c.triangle[i];
        add(v[t[0]], v[t[1]], v[t[2]], cut);
    }
    return c.leaves;
}

unsigned LocalMesh::march_in_cube(const Cube& cube, std::size_t order, double iso, bool cut) {
    const CubeCase& c = cube_cases(is_mirror_image(cube.mirror))[cube.below];
    for (std::size_t i = c.first[order]; i < c.first[order + 1]; ++i) {
        const auto vertex = [&](std::size_t corner) {
            return vertices_.edge_of_cube(cube, c.triangle[i][corner], iso);
        };
        const std::uint32_t v0 = vertex(0);
        const std::uint32_t v1 = vertex(1);
        add(v0, v1, vertex(2), cut);
    }
    return c.first[order] < c.first[order + 1] ? 1 : 0;
}

bool LocalMesh::march_hexahedron(const Cube& cube, bool hits, double iso, bool cut) {
    if (cell_caps_ && cut) {
        return cell_caps_->march(vertices_, cube, iso, triangles_);
    }
    if (!hits) {
        return march_hexahedron_without_hits(vertices_, cube, iso, cut, triangles_);
    }
    const unsigned nodes = cell_caps_ ? cell_caps_->corners_far_from_faces(cube) : 0xFF;
    return detail::march_hexahedron(vertices_, cube, iso, cut, triangles_, nodes);
}

void LocalMesh::march_line(const std::array<Corner, 3>& corners, double iso, bool cut) {
    lines_ = true;
    std::array<std::uint32_t, 2> ends{kNoMidpoint, kNoMidpoint};
    std::size_t count = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const Corner& a = corners[i];
        const Corner& b = corners[(i + 1) % 3];
        if ((a.value < iso) != (b.value < iso)) {
            const Corner& above = a.value < iso ? b : a;
            ends.at(count++) =
                above.value == iso ? vertices_.node(above.node) : edge_vertex(a, b, iso);
        }
    }
    if (count == 2 && ends[0] != ends[1]) {
        add(ends[0], ends[1], ends[1], cut);
    }
}

void LocalMesh::add_graph(const std::array<Corner, 3>& corners, bool cut) {
    const Int3 a = corners[1].node - corners[0].node;
    const Int3 b = corners[2].node - corners[0].node;
    const bool up = a.x * b.y - a.y * b.x > 0;
    std::array<std::uint32_t, 3> v{};
    for (std::size_t i = 0; i < 3; ++i) {
        const Corner& c = corners[i];
        v[i] = vertices_.node(c.node, c.value);
    }
    add(v[0], v[up ? 1 : 2], v[up ? 2 : 1], cut);
}

MeshPart LocalMesh::finish(const ClipBox& box) {
    MeshPart part = finish_part(vertices_, triangles_, lines_, box);
    if (single_sheet_ || lines_) {
        part.cut_fans = 0;
    }
    vertices_.clear();
    triangles_.clear();
    return part;
}

}  // namespace isonest::detail
