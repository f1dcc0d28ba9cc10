#include "query/simplify/proof/star_displacement.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isonest::detail {
namespace {

/// A triangle whose area is a smaller part of what its edges allow is seen from its side.
constexpr double kLeastSine = 1e-6;

template <class P>
double turn(const P& a, const P& b) {
    return a.u * b.v - a.v * b.u;
}

/// Whether the turn from `a` to `b` is to the left, and not nearly straight on or back.
template <class P>
bool turns_left(const P& a, const P& b) {
    const double area = turn(a, b);
    return area > 0 && area * area > kLeastSine * kLeastSine * (a.u * a.u + a.v * a.v) *
                                         (b.u * b.u + b.v * b.v);
}

}  // namespace

/// Puts the edges in order, the first one from `to` on.
bool StarDisplacement::find_ring(std::uint32_t to) {
    constexpr std::size_t kMost = 32;
    if (opposite_.size() < 3 || opposite_.size() > kMost) {
        return false;
    }
    ring_.clear();
    std::uint32_t at = to;
    while (ring_.size() < opposite_.size()) {
        const auto edge = std::find_if(opposite_.begin(), opposite_.end(),
                                       [&](const auto& e) { return e[0] == at; });
        if (edge == opposite_.end() || (at == to && !ring_.empty())) {
            return false;
        }
        ring_.push_back(at);
        at = (*edge)[1];
    }
    return at == to;
}

/// Along the vector area of the ring, which is that of all that it borders.
void StarDisplacement::look_down(std::uint32_t from) {
    const auto point = [&](std::uint32_t v) {
        Double3 p{};
        for (std::size_t a = 0; a < 3; ++a) {
            p[a] = static_cast<double>(positions_[v][a]) - static_cast<double>(positions_[from][a]);
        }
        return p;
    };
    Double3 up{};
    for (std::size_t i = 0; i < ring_.size(); ++i) {
        const Double3 n = cross(point(ring_[i]), point(ring_[(i + 1) % ring_.size()]));
        up = along(up, 1, n);
    }
    const double size = length(up);
    up = {up[0] / size, up[1] / size, up[2] / size};
    const std::size_t flat = std::fabs(up[0]) < std::fabs(up[1])
                                 ? (std::fabs(up[0]) < std::fabs(up[2]) ? 0U : 2U)
                                 : (std::fabs(up[1]) < std::fabs(up[2]) ? 1U : 2U);
    Double3 axis{};
    axis[flat] = 1;
    Double3 right = cross(axis, up);
    const double width = length(right);
    right = {right[0] / width, right[1] / width, right[2] / width};
    const Double3 ahead = cross(up, right);
    seen_.clear();
    for (const std::uint32_t v : ring_) {
        const Double3 p = point(v);
        seen_.push_back({dot(p, right), dot(p, ahead), dot(p, up)});
    }
}

/// And all triangles, before and after, lie front side up.
bool StarDisplacement::goes_once_around() const {
    const std::size_t count = seen_.size();
    int rounds = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const Seen& p = seen_[i];
        const Seen& q = seen_[(i + 1) % count];
        if (!turns_left(p, q)) {
            return false;
        }
        rounds += p.v < 0 && q.v >= 0 ? 1 : 0;
    }
    const Seen& first = seen_[0];
    for (std::size_t j = 1; j + 1 < count; ++j) {
        const Seen p{seen_[j].u - first.u, seen_[j].v - first.v, 0};
        const Seen q{seen_[j + 1].u - first.u, seen_[j + 1].v - first.v, 0};
        if (!turns_left(p, q)) {
            return false;
        }
    }
    return rounds == 1;
}

/// How high the triangle after of the ring's edge from corner `j` on is over the middle; 0 if it is
/// not over it.
double StarDisplacement::over_middle(std::size_t j) const {
    const Seen& a = seen_[0];
    const Seen& b = seen_[j];
    const Seen& c = seen_[j + 1];
    const double at_a = turn(b, c);
    const double at_b = turn(c, a);
    const double at_c = turn(a, b);
    if (at_a < 0 || at_b < 0 || at_c < 0) {
        return 0;
    }
    return std::fabs(at_a * a.height + at_b * b.height + at_c * c.height) / (at_a + at_b + at_c);
}

/// The most that the edge to corner `j` is above or below the edges from the middle that it
/// crosses.
double StarDisplacement::over_spokes(std::size_t j) const {
    const Seen& a = seen_[0];
    const Seen& b = seen_[j];
    const Seen edge{b.u - a.u, b.v - a.v, b.height - a.height};
    const double side = turn(a, b);  // > 0: the middle is to the left
    const std::size_t begin = side > 0 ? 1 : j + 1;
    const std::size_t end = side > 0 ? j : seen_.size();
    double most = 0;
    for (std::size_t i = begin; i < end; ++i) {
        const Seen& c = seen_[i];
        const double by = turn(edge, c);
        if (by == 0) {
            return std::numeric_limits<double>::infinity();
        }
        // Where the two cross: a + s edge = t c.
        const double s = std::clamp(-turn(a, c) / by, 0.0, 1.0);
        const double t = std::clamp(turn(edge, a) / by, 0.0, 1.0);
        most = std::max(most, std::fabs(a.height + s * edge.height - t * c.height));
    }
    return most;
}

std::optional<double> StarDisplacement::of(std::uint32_t from, std::uint32_t to) {
    if (!find_ring(to)) {
        return std::nullopt;
    }
    look_down(from);
    if (!goes_once_around()) {
        return std::nullopt;
    }
    double most = 0;
    for (std::size_t j = 1; j + 1 < seen_.size(); ++j) {
        most = std::max(most, over_middle(j));
        if (j > 1) {
            most = std::max(most, over_spokes(j));
        }
    }
    return std::isfinite(most) ? std::optional(most) : std::nullopt;
}

}  // namespace isonest::detail
