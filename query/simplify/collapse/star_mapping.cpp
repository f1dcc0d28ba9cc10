#include "query/simplify/collapse/star_mapping.h"

#include <algorithm>
#include <cmath>

namespace isonest::detail {
namespace {

/// A triangle with a smaller area relative to its edges is seen from its side.
constexpr double kMinSine = 1e-6;
/// If a point is closer to a spoke than this (as a sine), its side is uncertain.
constexpr double kUnclear = 1e-12;
/// 64 times the rounding of double, for sums of a few products.
constexpr double kSumRounding = 1e-14;

template <class P>
double turn(const P& a, const P& b) {
    return a.u * b.v - a.v * b.u;
}

/// Whether the turn from `a` to `b` is to the left, and not nearly straight on or back.
template <class P>
bool turns_left(const P& a, const P& b) {
    const double area = turn(a, b);
    return area > 0 &&
           area * area > kMinSine * kMinSine * (a.u * a.u + a.v * a.v) * (b.u * b.u + b.v * b.v);
}

}  // namespace

/// Projects along the vector area of the ring, which is the same for all surfaces that it bounds.
void FanOverlay::look_down() {
    const auto& p = star_->ring;
    up_ = {};
    for (std::size_t i = 0; i < count_; ++i) {
        const Double3 n = cross(p[i], p[i + 1 < count_ ? i + 1 : 0]);
        up_ = {up_[0] + n[0], up_[1] + n[1], up_[2] + n[2]};
    }
    const bool is_straight = star_->is_straight;
    const bool is_border = star_->missing != Star::kNone && !is_straight;
    Double3 along{};
    if (is_straight) {
        along = minus(p[star_->missing + 1 < count_ ? star_->missing + 1 : 0], p[star_->missing]);
        const double rest = dot(up_, along) / dot(along, along);
        up_ = {up_[0] - rest * along[0], up_[1] - rest * along[1], up_[2] - rest * along[2]};
    } else if (is_border) {
        up_[star_->axis] = 0;
    }
    const double size = length(up_);
    up_ = {up_[0] / size, up_[1] / size, up_[2] / size};
    std::size_t flat = 0;
    for (std::size_t a = 1; a < 3; ++a) {
        flat = std::fabs(up_[a]) < std::fabs(up_[flat]) ? a : flat;
    }
    if (is_border) {
        flat = star_->axis;
    }
    Double3 right{};
    if (is_border) {
        // Corners in the border's plane are projected to exactly 0.
        right[flat] = 1;
    } else {
        if (!is_straight) {
            along[flat] = 1;
        }
        right = cross(along, up_);
        const double width = length(right);
        right = {right[0] / width, right[1] / width, right[2] / width};
    }
    const Double3 ahead = cross(up_, right);
    widest_ = 0;
    highest_ = 0;
    for (std::size_t i = 0; i < count_; ++i) {
        Seen& s = seen_[i];
        s = {dot(p[i], right), dot(p[i], ahead), dot(p[i], up_)};
        widest_ = std::max(widest_, s.u * s.u + s.v * s.v);
        highest_ = std::max(highest_, std::fabs(s.height));
    }
    widest_ = std::sqrt(widest_);
    rounding_ = kSumRounding * (widest_ + highest_);
    if (is_straight) {
        // The ideal line goes through the middle.
        for (const std::size_t i : {star_->missing, star_->missing + 1}) {
            Seen& s = seen_[i < count_ ? i : 0];
            rounding_ = std::max(rounding_, 2 * std::fabs(s.u));
            s.u = 0;
        }
    }
}

/// Also requires that the ring goes once around the middle.
bool FanOverlay::are_front_sides_up() const {
    int rounds = 0;
    for (std::size_t i = 0; i < count_; ++i) {
        const Seen& p = seen_[i];
        const Seen& q = seen_[i + 1 < count_ ? i + 1 : 0];
        if (i == star_->missing) {
            // The middle is on the edge between them.
            if (p.u != 0 || q.u != 0 || !(p.v * q.v < 0)) {
                return false;
            }
        } else if (!turns_left(p, q)) {
            return false;
        }
        rounds += p.v < 0 && q.v >= 0 ? 1 : 0;
    }
    const Seen& first = seen_[0];
    for (std::size_t j = 1; j + 1 < count_; ++j) {
        const Seen p{seen_[j].u - first.u, seen_[j].v - first.v, 0};
        const Seen q{seen_[j + 1].u - first.u, seen_[j + 1].v - first.v, 0};
        if (!turns_left(p, q)) {
            return false;
        }
    }
    return rounds == 1;
}

bool FanOverlay::look_at(const Star& star) {
    if (star.missing != Star::kNone && star.axis == Star::kNone && !star.is_straight) {
        return false;
    }
    star_ = &star;
    count_ = star.corners;
    look_down();
    return are_front_sides_up();
}

/// Intersects each new spoke with the old ones on its other side.
bool FanOverlay::cross_spokes() {
    const std::size_t n = count_;
    for (std::size_t j = 1; j < n; ++j) {
        above_[0][j] = above_[j][j] = above_[n][j] = 0;
    }
    left_[1] = right_[n - 1] = true;
    right_[1] = left_[n - 1] = false;
    const Seen& a = seen_[0];
    for (std::size_t j = 2; j + 1 < n; ++j) {
        const Seen& b = seen_[j];
        const Seen edge{b.u - a.u, b.v - a.v, b.height - a.height};
        const double side = turn(a, b);
        const double unclear =
            kUnclear * std::sqrt((a.u * a.u + a.v * a.v) * (b.u * b.u + b.v * b.v));
        left_[j] = side > -unclear;
        right_[j] = side < unclear;
        const std::size_t begin = left_[j] ? 1 : j + 1;
        const std::size_t end = right_[j] ? n : j;
        for (std::size_t i = begin; i < end; ++i) {
            if (i == j) {
                continue;
            }
            const Seen& c = seen_[i];
            const double by = turn(edge, c);
            if (by == 0) {
                return false;
            }
            // Intersection of the two: a + s edge = t c.
            const double inverse = 1 / by;
            const double s = std::clamp(-turn(a, c) * inverse, 0.0, 1.0);
            const double t = std::clamp(turn(edge, a) * inverse, 0.0, 1.0);
            above_[i][j] = a.height + s * edge.height - t * c.height;
            rounding_ = std::max(
                rounding_, 2 * kSumRounding * widest_ * widest_ * highest_ * std::fabs(inverse));
        }
    }
    return true;
}

/// Height of new triangle `j` above the middle, which is in it.
bool FanOverlay::look_over_middle(std::size_t j) {
    const Seen& a = seen_[0];
    const Seen& b = seen_[j];
    const Seen& c = seen_[j + 1];
    const double at_a = turn(b, c);
    const double at_b = turn(c, a);
    const double at_c = turn(a, b);
    const double sum = at_a + at_b + at_c;
    if (!(sum > 0)) {
        return false;
    }
    over_[j] = (at_a * a.height + at_b * b.height + at_c * c.height) / sum;
    rounding_ = std::max(rounding_, 2 * kSumRounding * widest_ * widest_ * highest_ / sum);
    return true;
}

bool FanOverlay::crosses() {
    if (!cross_spokes()) {
        return false;
    }
    for (std::size_t j = 1; j + 1 < count_; ++j) {
        if (has_middle(j) && !look_over_middle(j)) {
            return false;
        }
    }
    return true;
}

Displacement FanOverlay::displacement(std::size_t j,
                                      std::span<const Displacement* const> before) const {
    const std::size_t n = count_;
    std::array<double, 3> lo{};
    std::array<double, 3> hi{};
    lo.fill(std::numeric_limits<double>::infinity());
    hi.fill(-std::numeric_limits<double>::infinity());
    float radius = 0;
    const bool all = has_middle(j);
    const std::size_t begin = all || left_[j] ? 0 : j;
    const std::size_t end = all || !left_[j] ? n : j + 1;
    for (std::size_t i = begin; i < end; ++i) {
        if (i == star_->missing) {
            continue;
        }
        double least = 0;
        double most = 0;
        const auto take = [&](double x) {
            least = std::min(least, x);
            most = std::max(most, x);
        };
        if (i == j) {
            // Both contain the edge from corner j to j + 1.
            take(all ? over_[j] : left_[j] ? above_[j][j + 1] : above_[j + 1][j]);
        } else if (all) {
            least = most = over_[j];
            take(above_[i][i < j ? j : j + 1]);
            take(above_[i + 1][i < j ? j : j + 1]);
        } else {
            least = most = above_[i][j];
            take(above_[i + 1][j]);
            take(above_[i][j + 1]);
            take(above_[i + 1][j + 1]);
        }
        least -= rounding_;
        most += rounding_;
        const Displacement& old = *before[i];
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double x = least * up_[axis];
            const double y = most * up_[axis];
            lo[axis] = std::min(lo[axis], static_cast<double>(old.lo[axis]) + std::min(x, y));
            hi[axis] = std::max(hi[axis], static_cast<double>(old.hi[axis]) + std::max(x, y));
        }
        radius = std::max(radius, old.radius);
    }
    Displacement d;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // Computed positions are also off by rounding perpendicular to `up`.
        d.lo[axis] = float_below(lo[axis] - rounding_);
        d.hi[axis] = float_above(hi[axis] + rounding_);
    }
    d.radius = radius;
    return d;
}

}  // namespace isonest::detail
