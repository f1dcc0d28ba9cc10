#include "query/simplify/sheets/nodes_passed.h"

#include <algorithm>
#include <cmath>

namespace isonest::detail {
namespace {

double volume_of(const Double3& a, const Double3& b, const Double3& c, const Double3& d) {
    return dot(minus(b, a), cross(minus(c, a), minus(d, a)));
}

/// Numbers k = 0, 1, ... at which all of several linear functions are at least 0, but for rounding.
class Interval {
  public:
    explicit Interval(std::int64_t last) : upper_(static_cast<double>(last)) {}
    /// The function that is `at_0` at 0 and `at_1` at 1.
    void cut(double at_0, double at_1) {
        const double slope = at_1 - at_0;
        if (slope > 0) {
            lower_ = std::max(lower_, -at_0 / slope - kRounding);
        } else if (slope < 0) {
            upper_ = std::min(upper_, -at_0 / slope + kRounding);
        } else if (at_0 < 0) {
            upper_ = -1;
        }
    }
    [[nodiscard]] bool has_number() const { return std::ceil(lower_) <= std::floor(upper_); }

  private:
    static constexpr double kRounding = 1e-6;
    double lower_ = 0;
    double upper_;
};

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
        lo[axis] = static_cast<std::int64_t>(std::ceil(std::clamp(least - margin_, 0.0, last + 1)));
        hi[axis] = static_cast<std::int64_t>(std::floor(std::clamp(most + margin_, -1.0, last)));
    }
    if (lo.x > hi.x || lo.y > hi.y || lo.z > hi.z) {
        return false;
    }
    // Of the face across from each corner: what its plane's distance from a point is measured in.
    std::array<double, 4> near{};
    for (std::size_t i = 0; i < 4; ++i) {
        const Double3& a = t[(i + 1) % 4];
        near[i] = margin_ * length(cross(minus(t[(i + 2) % 4], a), minus(t[(i + 3) % 4], a)));
    }
    const auto volumes = [&t](const Double3& p) {
        return std::array<double, 4>{volume_of(p, t[1], t[2], t[3]), volume_of(t[0], p, t[2], t[3]),
                                     volume_of(t[0], t[1], p, t[3]),
                                     volume_of(t[0], t[1], t[2], p)};
    };
    for (std::int64_t z = lo.z; z <= hi.z; ++z) {
        for (std::int64_t y = lo.y; y <= hi.y; ++y) {
            // Along x the volumes are linear.
            Double3 p{static_cast<double>(lo.x), static_cast<double>(y), static_cast<double>(z)};
            const auto at_0 = volumes(p);
            p[0] += 1;
            const auto at_1 = volumes(p);
            Interval in(hi.x - lo.x);
            Interval turned(hi.x - lo.x);
            for (std::size_t i = 0; i < 4; ++i) {
                in.cut(at_0[i] + near[i], at_1[i] + near[i]);
                turned.cut(near[i] - at_0[i], near[i] - at_1[i]);
            }
            if (in.has_number() || turned.has_number()) {
                return true;
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
