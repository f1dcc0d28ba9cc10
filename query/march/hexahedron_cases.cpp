#include "query/march/hexahedron_cases.h"

#include <limits>
#include <stdexcept>

#include "query/march/triangulate_polygon.h"

namespace isonest::detail {
namespace {

constexpr std::uint8_t kNoEdge = 0xFF;

/// Where the side that begins on an edge ends, and in which face it lies.
struct Side {
    std::uint8_t to = kNoEdge;
    std::uint8_t face = 0;
};
using Sides = std::array<Side, kCubeEdges>;

/// Each run of corners below, on the way around a face, is cut off by a side.
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
