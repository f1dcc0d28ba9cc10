#include "query/simplify/proof/surface_distance.h"

#include <algorithm>
#include <cmath>

#include "query/simplify/proof/halves.h"

namespace isonest::detail {
namespace {

constexpr int kMostCuts = 48;
constexpr int kMostPieces = 1 << 18U;  ///< of one triangle; beyond them it counts as a miss
constexpr int kMostServerCuts = 12;
constexpr std::size_t kRecent = 8;
/// A piece that has more limits as its radius than this is cut along the edges of the surface: else
/// the pieces of a flat one would be the more the smaller the limit.
constexpr double kMuchLarger = 8;
/// A piece is cut until its radius is this share of the limit; then something is near its centre
/// more often than not.
const double kNearEnough = std::getenv("ISO_NEAR") ? atof(std::getenv("ISO_NEAR")) : 0.9;
const double kCut = std::getenv("ISO_CUT") ? atof(std::getenv("ISO_CUT")) : 1;

/// Cut along the edge of `by` that `t` reaches beyond furthest, if that is more than `least`.
/// The union of the parts is `t`.
bool cut_along(const Triangle& t, const Triangle& by, double least,
               std::array<Triangle, 3>& parts) {
    const Double3 normal = cross(minus(by[1], by[0]), minus(by[2], by[0]));
    std::array<double, 3> side{};
    double furthest = least;
    for (std::size_t e = 0; e < 3; ++e) {
        const Double3 out = cross(minus(by[(e + 1) % 3], by[e]), normal);
        const double size = std::sqrt(square(out));
        std::array<double, 3> beyond{};
        for (std::size_t i = 0; i < 3; ++i) {
            beyond[i] = dot(out, minus(t[i], by[e]));
        }
        const auto [lo, hi] = std::minmax_element(beyond.begin(), beyond.end());
        if (*lo < 0 && *hi > furthest * size) {
            furthest = *hi / size;
            side = beyond;
        }
    }
    if (!(furthest > least)) {
        return false;
    }
    std::size_t alone = 0;
    while ((side[alone] > 0) == (side[(alone + 1) % 3] > 0) ||
           (side[alone] > 0) == (side[(alone + 2) % 3] > 0)) {
        ++alone;
    }
    const std::size_t j = (alone + 1) % 3;
    const std::size_t k = (alone + 2) % 3;
    const auto on_edge = [&](std::size_t other) {
        return along(t[alone], side[alone] / (side[alone] - side[other]),
                     minus(t[other], t[alone]));
    };
    const Double3 p = on_edge(j);
    const Double3 q = on_edge(k);
    parts = {Triangle{t[alone], p, q}, Triangle{p, t[j], t[k]}, Triangle{p, t[k], q}};
    return true;
}

}  // namespace

bool SurfaceDistance::served_by(const Triangle& t, std::uint32_t server) {
    const Triangle by = surface_.triangle(server);
    double most = 0;
    for (const Double3& corner : t) {
        const double d = square_distance(corner, by);
        if (d > square_limit_) {
            return false;
        }
        most = std::max(most, d);
    }
    largest_ = std::max(largest_, std::sqrt(most));
    return true;
}

bool SurfaceDistance::serve(const Triangle& t, int depth) {
    const auto take = [&](std::uint32_t server) {
        if (!served_by(t, server)) {
            return false;
        }
        if (std::find(servers_.begin(), servers_.end(), server) == servers_.end()) {
            servers_.push_back(server);
        }
        return true;
    };
    for (std::size_t i = 0; i < recent_.size(); ++i) {
        if (take(recent_[i])) {
            remember(recent_[i], i);
            return true;
        }
    }
    const Double3 centre = centroid(t);
    bool any = false;
    if (surface_.near(centre, square_limit_, [&](std::uint32_t server) {
            any = true;
            if (!take(server)) {
                return false;
            }
            remember(server, recent_.size());
            return true;
        })) {
        return true;
    }
    if (!any || depth == kMostServerCuts) {
        miss_ = centre;
        return false;
    }
    const auto parts = halves(t);
    return serve(parts[0], depth + 1) && serve(parts[1], depth + 1);
}

bool SurfaceDistance::serves(const Triangle& t) {
    servers_.clear();
    largest_ = 0;
    return serve(t, 0);
}

/// Puts a triangle first; `place`: where it was.
void SurfaceDistance::remember(std::uint32_t triangle, std::size_t place) {
    if (place == recent_.size()) {
        if (place == kRecent) {
            --place;
        } else {
            recent_.push_back(triangle);
        }
    }
    std::copy_backward(recent_.begin(), recent_.begin() + static_cast<std::ptrdiff_t>(place),
                       recent_.begin() + static_cast<std::ptrdiff_t>(place) + 1);
    recent_.front() = triangle;
}

/// Whether one of the recent triangles is near to all that is within the radius of the centre.
bool SurfaceDistance::is_near_recent(const Double3& centre, double radius) {
    const double enough = limit_ - radius;
    for (std::size_t i = 0; i < recent_.size(); ++i) {
        const double d = square_distance(centre, surface_.triangle(recent_[i]));
        if (d <= enough * enough) {
            largest_ = std::max(largest_, std::min(std::sqrt(d) + radius, limit_));
            remember(recent_[i], i);
            return true;
        }
    }
    return false;
}

bool SurfaceDistance::cover(const Triangle& t, int depth) {
    const Double3 centre = centroid(t);
    double radius = 0;
    for (const Double3& corner : t) {
        radius = std::max(radius, square(minus(corner, centre)));
    }
    radius = std::sqrt(radius);
    const auto miss = [&] {
        miss_ = centre;
        return false;
    };
    ++pieces_;
    const bool is_last = depth == kMostCuts || pieces_ > kMostPieces;
    const auto cut = [&] {
        const auto parts = halves(t);
        return cover(parts[0], depth + 1) && cover(parts[1], depth + 1);
    };
    if (radius > kMuchLarger * limit_) {
        const TriangleTree::Found found = surface_.nearest(centre, square_limit_);
        if (found.triangle == TriangleTree::kNone) {
            return miss();
        }
        if (served_by(t, found.triangle)) {
            return true;
        }
        std::array<Triangle, 3> parts;
        if (is_last) {
            return miss();
        }
        if (cut_along(t, surface_.triangle(found.triangle), limit_ / 2, parts)) {
            return std::all_of(parts.begin(), parts.end(),
                               [&](const Triangle& part) { return cover(part, depth + 1); });
        }
    }
    if (radius > std::max(kCut * limit_, size_) && !is_last) {
        return cut();
    }
    const bool is_small = radius < limit_ * kNearEnough;
    static const int serve = std::getenv("ISO_SERVE") ? atoi(std::getenv("ISO_SERVE")) : 0;
    if (serve) {
        for (std::size_t i = 0; i < recent_.size(); ++i) {
            const double d = square_distance(centre, surface_.triangle(recent_[i]));
            if (d > square_limit_) {
                continue;
            }
            if (std::sqrt(d) + radius <= limit_) {
                largest_ = std::max(largest_, std::sqrt(d) + radius);
            } else if (!served_by(t, recent_[i])) {
                continue;
            }
            remember(recent_[i], i);
            return true;
        }
    } else
    if (is_small && is_near_recent(centre, radius)) {
        return true;
    }
    // Any triangle that is near enough will do.
    bool any = false;
    if (surface_.near(centre, square_limit_, [&](std::uint32_t i) {
            const double d = square_distance(centre, surface_.triangle(i));
            if (d > square_limit_) {
                return false;
            }
            any = true;
            if (is_small && std::sqrt(d) + radius <= limit_) {
                largest_ = std::max(largest_, std::sqrt(d) + radius);
            } else if (!served_by(t, i)) {
                return false;
            }
            remember(i, recent_.size());
            return true;
        })) {
        return true;
    }
    return is_last || (is_small && !any) ? miss() : cut();
}

bool SurfaceDistance::covers(const Triangle& t) {
    pieces_ = 0;
    largest_ = 0;
    return cover(t, 0);
}

}  // namespace isonest::detail
