#include "query/simplify/sheets/nodes_passed.h"

#include <algorithm>
#include <cmath>

namespace isonest::detail {
namespace {

/// Distances between nodes: a node that is nearer to a tetrahedron counts as in it, so that
/// programs which round find it on its side, too.
constexpr double kNear = 1e-3;

double volume_of(const Double3& a, const Double3& b, const Double3& c, const Double3& d) {
    return dot(minus(b, a), cross(minus(c, a), minus(d, a)));
}

}  // namespace

Double3 NodesPassed::in_lattice(const Double3& world) const {
    Double3 p{};
    for (std::size_t a = 0; a < 3; ++a) {
        p[a] = (world[a] - lattice_.origin[a]) / lattice_.spacing[a];
    }
    return p;
}

bool NodesPassed::has_node(const Tetrahedron& t) const {
    Int3 lo{};
    Int3 hi{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto [least, most] = std::minmax({t[0][a], t[1][a], t[2][a], t[3][a]});
        const auto last = static_cast<double>(lattice_.nodes[axis] - 1);
        lo[axis] = static_cast<std::int64_t>(std::ceil(std::clamp(least - kNear, 0.0, last + 1)));
        hi[axis] = static_cast<std::int64_t>(std::floor(std::clamp(most + kNear, -1.0, last)));
    }
    if (lo.x > hi.x || lo.y > hi.y || lo.z > hi.z) {
        return false;
    }
    // Of the face across from each corner: what its plane's distance from a point is measured in.
    std::array<double, 4> near{};
    for (std::size_t i = 0; i < 4; ++i) {
        const Double3& a = t[(i + 1) % 4];
        near[i] = kNear * length(cross(minus(t[(i + 2) % 4], a), minus(t[(i + 3) % 4], a)));
    }
    for (std::int64_t z = lo.z; z <= hi.z; ++z) {
        for (std::int64_t y = lo.y; y <= hi.y; ++y) {
            for (std::int64_t x = lo.x; x <= hi.x; ++x) {
                const Double3 p{static_cast<double>(x), static_cast<double>(y),
                                static_cast<double>(z)};
                const std::array<double, 4> at{
                    volume_of(p, t[1], t[2], t[3]), volume_of(t[0], p, t[2], t[3]),
                    volume_of(t[0], t[1], p, t[3]), volume_of(t[0], t[1], t[2], p)};
                bool may_be_in = true;
                bool may_be_turned = true;
                for (std::size_t i = 0; i < 4; ++i) {
                    may_be_in = may_be_in && at[i] >= -near[i];
                    may_be_turned = may_be_turned && at[i] <= near[i];
                }
                if (may_be_in || may_be_turned) {
                    return true;
                }
            }
        }
    }
    return false;
}

bool NodesPassed::any(const Star& star, const Double3& middle, const Double3& slid) const {
    const auto at = [&](const Double3& from_middle) {
        return in_lattice(
            {middle[0] + from_middle[0], middle[1] + from_middle[1], middle[2] + from_middle[2]});
    };
    const Double3 now = at({0, 0, 0});
    const Double3 before = at({-slid[0], -slid[1], -slid[2]});
    const Double3 to = at(star.ring[0]);
    for (std::size_t i = 0; i < star.corners; ++i) {
        if (i == star.missing) {
            continue;
        }
        const Double3 a = at(star.ring[i]);
        const Double3 b = at(star.ring[i + 1 < star.corners ? i + 1 : 0]);
        const bool is_new = i > 0 && i + 1 < star.corners;
        if ((is_new && has_node({now, to, a, b})) ||
            (slid != Double3{} && has_node({before, now, a, b}))) {
            return true;
        }
    }
    return false;
}

}  // namespace isonest::detail
