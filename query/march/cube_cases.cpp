#include "query/march/cube_cases.h"

#include <algorithm>

#include "query/march/crossing.h"
#include "store/lattice/bisection.h"

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

/// LocalMesh::march for corners none of which has the isovalue.
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
    // Away from the corner that is alone if that is below, else towards it.
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

}  // namespace isonest::detail
