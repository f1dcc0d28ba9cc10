#include "query/simplify/proof/surface_distance.h"

#include <algorithm>
#include <cmath>

#include "query/simplify/proof/halves.h"

namespace isonest::detail {
namespace {

constexpr int kMostServerCuts = 12;
constexpr std::size_t kRecent = 8;

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

}  // namespace isonest::detail
