#include "query/simplify/lines/fewest_segments.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace isonest::detail {
namespace {

/// Cones are as wide as this share of the limit allows, so that rounding leaves what they found
/// within it; that is tested.
constexpr double kRounding = 1 - 1e-9;

double plane_cross(const PlanePoint& a, const PlanePoint& b) {
    return a[0] * b[1] - a[1] * b[0];
}
PlanePoint plane_vector(const PlanePoint& a, const PlanePoint& b) {
    return {a[0] - b[0], a[1] - b[1]};
}

/// The directions in which rays from a point come near to all points that were added. Less than a
/// half turn, once it is not all.
class Cone {
  public:
    explicit Cone(double limit) : limit_(limit) {}

    [[nodiscard]] bool holds(const PlanePoint& direction) const {
        return all_ || (plane_cross(right_, direction) >= 0 && plane_cross(direction, left_) >= 0);
    }
    /// `to`: from the point that the rays begin at. False if nothing is left.
    bool add(const PlanePoint& to) {
        const double square = to[0] * to[0] + to[1] * to[1];
        const double along = square - limit_ * limit_;
        if (!(along > 0)) {
            return true;
        }
        const double s = std::sqrt(along);
        Cone other(limit_);
        other.all_ = false;
        other.left_ = {to[0] * s - to[1] * limit_, to[0] * limit_ + to[1] * s};
        other.right_ = {to[0] * s + to[1] * limit_, to[1] * s - to[0] * limit_};
        if (all_) {
            *this = other;
            return true;
        }
        if (holds(other.right_)) {
            right_ = other.right_;
        } else if (!other.holds(right_)) {
            return false;
        }
        if (holds(other.left_)) {
            left_ = other.left_;
        } else if (!other.holds(left_)) {
            return false;
        }
        return true;
    }

  private:
    double limit_;
    bool all_ = true;
    PlanePoint left_{};
    PlanePoint right_{};
};

/// The point between with the largest measure, but for `but`; the first of several.
template <class Measure>
std::uint32_t furthest(std::span<const PlanePoint> points, std::uint32_t but,
                       const Measure& measure) {
    std::uint32_t best = 0;
    double most = -1;
    for (std::uint32_t i = 1; i + 1 < points.size(); ++i) {
        const double d = measure(points[i]);
        if (i != but && d > most) {
            most = d;
            best = i;
        }
    }
    return best;
}

}  // namespace

double square_distance_to_segment(const PlanePoint& p, const PlanePoint& a, const PlanePoint& b) {
    const PlanePoint ab = plane_vector(b, a);
    const PlanePoint ap = plane_vector(p, a);
    const double size = ab[0] * ab[0] + ab[1] * ab[1];
    const double t = size > 0 ? std::clamp((ap[0] * ab[0] + ap[1] * ab[1]) / size, 0.0, 1.0) : 0.0;
    const PlanePoint d = plane_vector(ap, {t * ab[0], t * ab[1]});
    return d[0] * d[0] + d[1] * d[1];
}

void FewestSegments::shortest_path(std::span<const PlanePoint> points, std::uint32_t first,
                                   double limit) {
    const auto n = static_cast<std::uint32_t>(points.size());
    const auto are_near = [&](std::uint32_t i, std::uint32_t j) {
        return std::all_of(points.begin() + i + 1, points.begin() + j, [&](const PlanePoint& p) {
            return square_distance_to_segment(p, points[i], points[j]) <= limit * limit;
        });
    };
    if (points.front() != points.back() && are_near(0, n - 1)) {
        kept_.push_back(first + n - 1);  // straight lines, where the search takes longest
        return;
    }
    const std::size_t words = (points.size() + 63) / 64;
    near_.assign(words * n, 0);
    for (std::uint32_t i = 0; i + 1 < n; ++i) {
        Cone cone(limit * kRounding);
        for (std::uint32_t j = i + 1; j < n; ++j) {
            const PlanePoint to = plane_vector(points[j], points[i]);
            if (!cone.add(to)) {
                break;
            }
            if (cone.holds(to)) {
                near_[i * words + j / 64] |= std::uint64_t{1} << (j % 64);
            }
        }
    }
    hops_.assign(n, 0);
    before_.assign(n, 0);
    for (std::uint32_t j = 1; j < n; ++j) {
        hops_[j] = hops_[j - 1] + 1;
        before_[j] = j - 1;
        Cone cone(limit * kRounding);
        for (std::uint32_t i = j; i-- > 0;) {
            const PlanePoint to = plane_vector(points[i], points[j]);
            if (!cone.add(to)) {
                break;
            }
            const auto from_other_end = [&] {
                return (near_[i * words + j / 64] >> (j % 64) & 1U) != 0;
            };
            if (hops_[i] + 1 < hops_[j] && cone.holds(to) && from_other_end() &&
                points[i] != points[j]) {
                hops_[j] = hops_[i] + 1;
                before_[j] = i;
            }
        }
    }
    const std::size_t begin = kept_.size();
    for (std::uint32_t j = n - 1; j > 0;) {
        const std::uint32_t i = before_[j];
        kept_.push_back(first + j);
        j = are_near(i, j) ? i : j - 1;
    }
    std::reverse(kept_.begin() + static_cast<std::ptrdiff_t>(begin), kept_.end());
}

void FewestSegments::with_least(std::span<const PlanePoint> points, double limit,
                                std::uint32_t least) {
    std::vector<std::uint32_t> ends{0, static_cast<std::uint32_t>(points.size() - 1)};
    const PlanePoint& a = points.front();
    const std::uint32_t far = furthest(points, 0, [&](const PlanePoint& p) {
        return square_distance_to_segment(p, a, points.back());
    });
    ends.push_back(far);
    if (least == 3) {
        // Of a loop: with the first two corners the largest triangle.
        ends.push_back(furthest(points, far, [&](const PlanePoint& p) {
            return std::fabs(plane_cross(plane_vector(points[far], a), plane_vector(p, a)));
        }));
    }
    std::sort(ends.begin(), ends.end());
    kept_.assign(1, 0);
    for (std::size_t e = 1; e < ends.size(); ++e) {
        shortest_path(points.subspan(ends[e - 1], ends[e] - ends[e - 1] + 1), ends[e - 1], limit);
    }
}

std::span<const std::uint32_t> FewestSegments::find(std::span<const PlanePoint> points,
                                                    double limit, std::uint32_t least) {
    if (points.size() <= std::size_t{least} + 1) {
        kept_.resize(points.size());
        for (std::uint32_t i = 0; i < kept_.size(); ++i) {
            kept_[i] = i;
        }
        return kept_;
    }
    kept_.assign(1, 0);
    shortest_path(points, 0, limit);
    bool is_enough = kept_.size() > least;
    if (least == 3 && kept_.size() == 4) {
        const PlanePoint& a = points[kept_[0]];
        is_enough =
            plane_cross(plane_vector(points[kept_[1]], a), plane_vector(points[kept_[2]], a)) != 0;
    }
    if (!is_enough) {
        with_least(points, limit, least);
    }
    return kept_;
}

}  // namespace isonest::detail
