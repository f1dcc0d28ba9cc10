#include "query/mesh/nudge_vertex.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <utility>
#include <vector>

#include "query/mesh/zero_area.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;

Double3 normal_of(const Point& a, const OppositeSide& side) {
    const auto from_a = [&a](const Point& p) {
        Double3 d{};
        for (std::size_t i = 0; i < 3; ++i) {
            d[i] = static_cast<double>(p[i]) - static_cast<double>(a[i]);
        }
        return d;
    };
    return cross(from_a(side[0]), from_a(side[1]));
}

/// How the triangles face before the move.
std::vector<Double3> facings(const Point& vertex, std::span<const OppositeSide> around) {
    std::vector<Double3> normals;
    normals.reserve(around.size());
    Double3 sum{};
    for (const OppositeSide& side : around) {
        normals.push_back(normal_of(vertex, side));
        for (std::size_t i = 0; i < 3; ++i) {
            sum[i] += normals.back()[i];
        }
    }
    for (std::size_t i = 0; i < around.size(); ++i) {
        if (missing_dimensions(vertex, around[i][0], around[i][1]) > 0) {
            normals[i] = sum;
        }
    }
    return normals;
}

float stepped(float from, double least, int steps) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    const float size = std::fabs(from);
    const double unit = static_cast<double>(std::nextafter(size, kInfinity)) - size;
    return static_cast<float>(from + steps * std::max(unit, least));
}

double square_height(const Point& a, const OppositeSide& side, const Double3& normal) {
    double longest = 0;
    for (const auto& [p, q] :
         {std::pair{a, side[0]}, std::pair{a, side[1]}, std::pair{side[0], side[1]}}) {
        double square = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            const double d = static_cast<double>(q[i]) - static_cast<double>(p[i]);
            square += d * d;
        }
        longest = std::max(longest, square);
    }
    return longest > 0 ? dot(normal, normal) / longest : 0;
}

/// The vertex at `to`; nothing if no dimension is gained, or a triangle loses one. `missing`,
/// `facing`: of the triangles before.
std::optional<Nudge> tried(const Point& to, std::span<const OppositeSide> around,
                           const std::vector<int>& missing, const std::vector<Double3>& facing) {
    Nudge next{to, 0, 0, std::numeric_limits<double>::infinity()};
    for (std::size_t i = 0; i < around.size(); ++i) {
        const int left = missing_dimensions(to, around[i][0], around[i][1]);
        if (left > missing[i]) {
            return {};
        }
        next.mended += missing[i] - left;
        const Double3 normal = normal_of(to, around[i]);
        next.turned += dot(normal, facing[i]) < 0 ? 1 : 0;
        if (left == 0) {
            next.square_height = std::min(next.square_height, square_height(to, around[i], normal));
        }
    }
    return next.mended > 0 ? std::optional(next) : std::nullopt;
}

bool is_better(const Nudge& a, const Nudge& b) {
    return a.turned != b.turned   ? a.turned < b.turned
           : a.mended != b.mended ? a.mended > b.mended
                                  : a.square_height > b.square_height;
}

}  // namespace

int missing_dimensions(const Point& a, const Point& b, const Point& c) {
    return !has_no_area(a, b, c) ? 0 : a == b && b == c ? 2 : 1;
}

std::optional<Nudge> nudged(const Point& vertex, std::span<const OppositeSide> around,
                            const NudgeRange& range, int steps, NudgeFreedom freedom) {
    const std::vector<Double3> facing = facings(vertex, around);
    std::vector<int> missing(around.size());
    std::transform(around.begin(), around.end(), missing.begin(), [&](const OppositeSide& side) {
        return missing_dimensions(vertex, side[0], side[1]);
    });
    std::array<std::vector<float>, 3> places;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float at = vertex[axis];
        const bool on_face = at == range.lo[axis] || at == range.hi[axis];
        for (int s = -steps; s <= steps; ++s) {
            float to = stepped(at, range.least_step[axis], s);
            if (freedom == NudgeFreedom::stay_on_faces && on_face) {
                to = at;
            } else if (freedom != NudgeFreedom::anywhere) {
                to = std::clamp(to, range.lo[axis], range.hi[axis]);
            }
            places[axis].push_back(to);
        }
    }
    std::optional<Nudge> best;
    const auto count = static_cast<std::size_t>(2 * steps + 1);
    const auto is_end = [&](std::size_t i) { return i == 0 || i + 1 == count; };
    for (std::size_t z = 0; z < count; ++z) {
        for (std::size_t y = 0; y < count; ++y) {
            for (std::size_t x = 0; x < count; ++x) {
                if (!is_end(x) && !is_end(y) && !is_end(z)) {
                    continue;
                }
                const std::optional<Nudge> next =
                    tried({places[0][x], places[1][y], places[2][z]}, around, missing, facing);
                if (next && (!best || is_better(*next, *best))) {
                    best = next;
                }
            }
        }
    }
    return best;
}

}  // namespace isonest::detail
