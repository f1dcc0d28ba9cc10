#include "query/march/cube_cases.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "query/march/march_hexahedron.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

/// A triangle's corners, each on the edge between two corners of the cube.
using Ends = std::array<std::array<std::uint8_t, 2>, 3>;

void add(CubeCase& c, std::size_t order, const Ends& ends) {
    auto& triangle = c.triangle[c.first[order + 1]++];
    for (std::size_t i = 0; i < 3; ++i) {
        triangle[i] = edge_between(ends[i][0], ends[i][1]);
        auto* const end = c.edge.begin() + c.edges;
        if (std::find(c.edge.begin(), end, triangle[i]) == end) {
            c.edge[c.edges++] = triangle[i];
        }
    }
}

/// Corresponds to LocalMesh::march for corners that do not have the isovalue.
void add_tetrahedron(CubeCase& c, std::size_t order, const std::array<std::uint8_t, 4>& corners,
                     bool positive, unsigned below) {
    c.first[order + 1] = c.first[order];
    unsigned mask = 0;
    for (unsigned i = 0; i < 4; ++i) {
        mask |= ((below >> corners[i]) & 1U) << i;
    }
    const Crossing& crossing = kCrossings[mask];
    if (crossing.below == 0 || crossing.below == 4) {
        return;
    }
    ++c.leaves;
    std::array<std::uint8_t, 4> at{};
    for (std::size_t i = 0; i < 4; ++i) {
        at[i] = corners[crossing.order[i]];
    }
    const bool outward = positive != crossing.flip;
    if (crossing.below == 2) {
        const std::uint8_t r1 = at[outward ? 2 : 3];
        const std::uint8_t r2 = at[outward ? 3 : 2];
        add(c, order, {{{at[0], r1}, {at[0], r2}, {at[1], r2}}});
        add(c, order, {{{at[0], r1}, {at[1], r2}, {at[1], r1}}});
        return;
    }
    // Away from the single corner if it is below, otherwise towards it.
    const bool forward = (crossing.below == 1) != outward;
    add(c, order, {{{at[0], at[1]}, {at[0], at[forward ? 2 : 3]}, {at[0], at[forward ? 3 : 2]}}});
}

CubeCases make_cases(bool mirrored) {
    CubeCases cases{};
    for (unsigned below = 0; below < cases.size(); ++below) {
        for (std::size_t order = 0; order < 6; ++order) {
            const auto& axes = kAxisOrders[order];
            std::array<std::uint8_t, 4> corners{};
            for (std::size_t i = 0; i < 3; ++i) {
                corners[i + 1] = static_cast<std::uint8_t>(corners[i] | 1U << axes[i]);
            }
            const bool even = (axes[1] + 3 - axes[0]) % 3 == 1;
            add_tetrahedron(cases[below], order, corners, even != mirrored, below);
        }
    }
    return cases;
}

}  // namespace

std::uint8_t edge_between(unsigned a, unsigned b) {
    const auto* const found = std::find_if(kCubeEdge.begin(), kCubeEdge.end(), [&](const auto& e) {
        return e.low == std::min(a, b) && e.high == std::max(a, b);
    });
    return static_cast<std::uint8_t>(found - kCubeEdge.begin());
}

const CubeCases& cube_cases(bool mirrored) {
    static const std::array<CubeCases, 2> cases{make_cases(false), make_cases(true)};
    return cases[mirrored ? 1 : 0];
}

namespace {

constexpr std::uint8_t kNoEdge = 0xFF;

/// The end of the side that starts on an edge, and the face that contains it.
struct Side {
    std::uint8_t to = kNoEdge;
    std::uint8_t face = 0;
};
using Sides = std::array<Side, kCubeEdges>;

/// Going around a face, each run of corners below is cut off by a side.
void add_sides(Sides& sides, unsigned face, unsigned below) {
    const std::array<unsigned, 4> corner = corners_of_face(face);
    const auto is_below = [&](std::size_t i) { return (below >> corner[i % 4] & 1U) != 0; };
    for (std::size_t first = 0; first < 4; ++first) {
        if (!is_below(first) || is_below(first + 3)) {
            continue;
        }
        std::size_t last = first;
        while (is_below(last + 1)) {
            ++last;
        }
        const std::uint8_t entry = edge_between(corner[(first + 3) % 4], corner[first]);
        const std::uint8_t exit = edge_between(corner[last % 4], corner[(last + 1) % 4]);
        sides[exit] = {entry, static_cast<std::uint8_t>(face)};
    }
}

double squared_distance(const CubeEdge& a, const CubeEdge& b) {
    const Int3 d = Int3{3, 3, 3}.unlinear(a.midpoint) - Int3{3, 3, 3}.unlinear(b.midpoint);
    return static_cast<double>(d.x * d.x + d.y * d.y + d.z * d.z);
}

void add_triangles(HexahedronCase& c, std::size_t first, std::size_t end) {
    const auto cost = [&](std::size_t i, std::size_t j) {
        const CubeEdge& a = kCubeEdge[c.edge[first + i]];
        const CubeEdge& b = kCubeEdge[c.edge[first + j]];
        return (faces_at(a) & faces_at(b)) != 0 ? std::numeric_limits<double>::infinity()
                                                : squared_distance(a, b);
    };
    const auto at = [&](std::size_t i) { return static_cast<std::uint8_t>(first + i); };
    if (!triangulate_polygon(end - first, cost, [&](auto i, auto j, auto k) {
            c.triangle.at(c.triangles++) = {at(i), at(j), at(k)};
        })) {
        throw std::logic_error("a polygon of a hexahedral cell has no triangles");
    }
}

HexahedronCase make_case(unsigned below) {
    Sides sides{};
    for (unsigned face = 0; face < 6; ++face) {
        add_sides(sides, face, below);
    }
    HexahedronCase c;
    for (std::size_t start = 0; start < kCubeEdges; ++start) {
        if (sides[start].to == kNoEdge) {
            continue;
        }
        const std::size_t first = c.edges;
        for (std::size_t at = start; sides[at].to != kNoEdge;) {
            c.edge.at(c.edges) = static_cast<std::uint8_t>(at);
            c.face.at(c.edges++) = sides[at].face;
            const std::uint8_t next = sides[at].to;
            sides[at].to = kNoEdge;
            at = next;
        }
        c.first.at(++c.polygons) = c.edges;
        add_triangles(c, first, c.edges);
    }
    return c;
}

}  // namespace

std::array<unsigned, 4> corners_of_face(unsigned face) {
    const unsigned axis = face / 2;
    const bool high = (face & 1U) != 0;
    const unsigned u = 1U << ((axis + 1) % 3);
    const unsigned v = 1U << ((axis + 2) % 3);
    const unsigned base = high ? 1U << axis : 0U;
    return {base, base | (high ? u : v), base | u | v, base | (high ? v : u)};
}

const HexahedronCases& hexahedron_cases() {
    static const HexahedronCases cases = [] {
        HexahedronCases made{};
        for (unsigned below = 0; below < made.size(); ++below) {
            made[below] = make_case(below);
        }
        return made;
    }();
    return cases;
}

}  // namespace isonest::detail
