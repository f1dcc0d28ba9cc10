#include "query/simplify/moved_vertices.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;

/// One of the six neighbours of a place that are a unit in the last place away.
Point neighbour(const Point& p, std::size_t direction) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    Point q = p;
    const std::size_t axis = direction / 2 % 3;
    q[axis] = std::nextafterf(p[axis], direction % 2 == 0 ? kFar : -kFar);
    return q;
}

}  // namespace

void MovedVertices::add(Copies& copies) {
    copies.seal();
    mesh_.add_copies(copies.all());
    for (const ScratchMesh::MovedCopy& copy : copies.all()) {
        origins_.append(copy.of);
    }
    origins_.seal();
}

double MovedVertices::give_own_places(std::span<std::uint64_t> vertices, double most) {
    constexpr std::size_t kMostRounds = 8;
    const auto at = mesh_.changeable_positions();
    double moved = 0;
    for (std::size_t round = 0; round < kMostRounds; ++round) {
        std::sort(vertices.begin(), vertices.end(), [&](std::uint64_t a, std::uint64_t b) {
            return at[a] != at[b] ? at[a] < at[b] : a < b;
        });
        double furthest = 0;
        std::size_t same = 0;  // in the place, before this one
        Point place{};
        for (std::size_t i = 0; i < vertices.size(); ++i) {
            const std::uint64_t v = vertices[i];
            same = i > 0 && at[v] == place ? same + 1 : 0;
            place = at[v];
            if (same == 0 || v < first_) {
                continue;
            }
            const Point to = neighbour(place, round + same - 1);
            const double by = length(minus(point_at(place), point_at(to)));
            if (moved + by <= most) {
                at[v] = to;
                furthest = std::max(furthest, by);
            }
        }
        if (furthest == 0) {
            break;
        }
        moved += furthest;
    }
    return moved;
}

}  // namespace isonest::detail
