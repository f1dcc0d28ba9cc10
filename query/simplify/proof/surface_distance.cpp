#include "query/simplify/proof/surface_distance.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

TriangleTree::TriangleTree(std::span<const std::array<float, 3>> positions,
                           std::vector<Corners> triangles)
    : positions_(positions), triangles_(std::move(triangles)), order_(triangles_.size()) {
    std::iota(order_.begin(), order_.end(), 0U);
    nodes_.reserve(triangles_.size());
    if (triangles_.empty()) {
        return;
    }
    std::vector<std::array<float, 3>> middles(triangles_.size());
    std::transform(triangles_.begin(), triangles_.end(), middles.begin(), [&](const Corners& c) {
        std::array<float, 3> sum{};
        for (std::size_t a = 0; a < 3; ++a) {
            sum[a] = positions_[c[0]][a] + positions_[c[1]][a] + positions_[c[2]][a];
        }
        return sum;
    });
    build(0, static_cast<std::uint32_t>(triangles_.size()), middles);
}

void TriangleTree::build(std::uint32_t first, std::uint32_t count,
                         const std::vector<std::array<float, 3>>& middles) {
    constexpr float kMax = std::numeric_limits<float>::max();
    Node node{{kMax, kMax, kMax}, {-kMax, -kMax, -kMax}, first, count};
    for (std::uint32_t i = first; i < first + count; ++i) {
        for (const std::uint32_t v : triangles_[order_[i]]) {
            for (std::size_t a = 0; a < 3; ++a) {
                node.lo[a] = std::min(node.lo[a], positions_[v][a]);
                node.hi[a] = std::max(node.hi[a], positions_[v][a]);
            }
        }
    }
    const std::size_t at = nodes_.size();
    nodes_.push_back(node);
    if (count <= kLeaf) {
        return;
    }
    std::size_t axis = 0;
    for (std::size_t a = 1; a < 3; ++a) {
        axis = node.hi[a] - node.lo[a] > node.hi[axis] - node.lo[axis] ? a : axis;
    }
    const std::uint32_t half = count / 2;
    const auto begin = order_.begin() + first;
    std::nth_element(begin, begin + half, begin + count, [&](std::uint32_t s, std::uint32_t t) {
        const float a = middles[s][axis];
        const float b = middles[t][axis];
        return a != b ? a < b : s < t;
    });
    build(first, half, middles);
    nodes_[at].count = 0;
    nodes_[at].first = static_cast<std::uint32_t>(nodes_.size());
    build(first + half, count - half, middles);
}

void TriangleTree::closest(std::uint32_t at, const Double3& p, Found& found) const {
    const Node& node = nodes_[at];
    if (node.count > 0) {
        for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
            const double d = square_distance(p, triangle(order_[i]));
            if (d < found.square_distance ||
                (d == found.square_distance && found.triangle == kNone)) {
                found = {order_[i], d};
            }
        }
        return;
    }
    std::array<std::uint32_t, 2> child{at + 1, node.first};
    std::array<double, 2> d{square_to_box(p, nodes_[child[0]]), square_to_box(p, nodes_[child[1]])};
    if (d[1] < d[0]) {
        std::swap(child[0], child[1]);
        std::swap(d[0], d[1]);
    }
    for (std::size_t i = 0; i < 2; ++i) {
        if (d[i] <= found.square_distance) {
            closest(child[i], p, found);
        }
    }
}

TriangleTree::Found TriangleTree::nearest(const Double3& p, double most) const {
    Found found{kNone, most};
    if (!nodes_.empty() && square_to_box(p, nodes_[0]) <= most) {
        closest(0, p, found);
    }
    return found;
}

namespace {

constexpr int kMaxWitnessCuts = 12;
constexpr std::size_t kRecent = 8;

}  // namespace

bool SurfaceDistance::served_by(const Triangle& t, std::uint32_t witness) {
    const Triangle by = surface_.triangle(witness);
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
    const auto take = [&](std::uint32_t witness) {
        if (!served_by(t, witness)) {
            return false;
        }
        if (std::find(witnesses_.begin(), witnesses_.end(), witness) == witnesses_.end()) {
            witnesses_.push_back(witness);
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
    if (surface_.near(centre, square_limit_, [&](std::uint32_t witness) {
            any = true;
            if (!take(witness)) {
                return false;
            }
            remember(witness, recent_.size());
            return true;
        })) {
        return true;
    }
    if (!any || depth == kMaxWitnessCuts) {
        miss_ = centre;
        return false;
    }
    const auto parts = halves(t);
    return serve(parts[0], depth + 1) && serve(parts[1], depth + 1);
}

bool SurfaceDistance::serves(const Triangle& t) {
    witnesses_.clear();
    largest_ = 0;
    return serve(t, 0);
}

/// Moves a triangle to the front; `place`: its old index.
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
