// Distances from points to a triangle mesh, exact up to rounding. No code of isonest is used here.
#pragma once

#include <algorithm>
#include <limits>
#include <span>

#include "tools/bench/meshes/ply_mesh.h"

namespace bench {

using Corners = std::array<Point, 3>;

/// The corners of triangle i.
inline Corners corners_of(const Mesh& mesh, std::size_t i) {
    const Triangle& t = mesh.triangles[i];
    return {mesh.points[t[0]], mesh.points[t[1]], mesh.points[t[2]]};
}

inline double squared_to_segment(const Point& p, const Point& a, const Point& b) {
    const Point ab = b - a;
    const Point ap = p - a;
    const double whole = dot(ab, ab);
    const double s = whole > 0 ? std::clamp(dot(ap, ab) / whole, 0.0, 1.0) : 0.0;
    const Point rest = ap - s * ab;
    return dot(rest, rest);
}

/// Exact up to rounding, also for triangles without area.
inline double squared_to_triangle(const Point& p, const Corners& t) {
    const Point normal = cross(t[1] - t[0], t[2] - t[0]);
    const double square = dot(normal, normal);
    bool above = square > 0;
    for (std::size_t i = 0; i < 3 && above; ++i) {
        above = dot(cross(t[(i + 1) % 3] - t[i], p - t[i]), normal) >= 0;
    }
    if (above) {
        const double height = dot(normal, p - t[0]);
        return height * height / square;
    }
    return std::min({squared_to_segment(p, t[0], t[1]), squared_to_segment(p, t[1], t[2]),
                     squared_to_segment(p, t[2], t[0])});
}

/// A bounding box tree over the triangles of a mesh: halved at the median of the centres along the
/// longest axis.
class Tree {
  public:
    struct Nearest {
        double squared = std::numeric_limits<double>::infinity();
        std::uint32_t triangle = 0;
    };

    /// REQUIRES: the mesh has triangles.
    explicit Tree(const Mesh& mesh) : corners_(mesh.triangles.size()) {
        std::vector<std::uint32_t> order(corners_.size());
        std::vector<std::array<float, 3>> centres(corners_.size());
        for (std::uint32_t i = 0; i < order.size(); ++i) {
            order[i] = i;
            const Corners t = corners_of(mesh, i);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                centres[i][axis] = static_cast<float>(t[0][axis] + t[1][axis] + t[2][axis]);
            }
        }
        nodes_.reserve(corners_.size());
        nodes_.emplace_back();
        build(0, 0, order, centres);
        for (std::size_t i = 0; i < order.size(); ++i) {
            corners_[i] = corners_of(mesh, order[i]);
        }
        for (std::size_t i = nodes_.size(); i-- > 0;) {
            fit(nodes_[i]);
        }
    }

    double squared(const Point& p, std::uint32_t triangle) const {
        return squared_to_triangle(p, corners_[triangle]);
    }

    /// The nearest triangle (in the tree's own numbering); the search starts with `guess`.
    Nearest nearest(const Point& p, std::uint32_t guess) const {
        Nearest best{squared(p, guess), guess};
        std::array<std::pair<std::uint32_t, double>, 64> stack;
        std::size_t size = 1;
        stack[0] = {0, to_box(p, nodes_[0])};
        while (size > 0) {
            const auto [index, far] = stack[--size];
            if (far >= best.squared) {
                continue;
            }
            const Node& node = nodes_[index];
            if (node.count > 0) {
                for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
                    const double d = squared(p, i);
                    if (d < best.squared) {
                        best = {d, i};
                    }
                }
                continue;
            }
            std::pair<std::uint32_t, double> near{node.first, to_box(p, nodes_[node.first])};
            std::pair<std::uint32_t, double> other{node.first + 1,
                                                   to_box(p, nodes_[node.first + 1])};
            if (other.second < near.second) {
                std::swap(near, other);
            }
            stack[size++] = other;
            stack[size++] = near;
        }
        return best;
    }

  private:
    struct Node {
        std::array<double, 3> low;
        std::array<double, 3> high;
        std::uint32_t first = 0;  ///< index of its first triangle, or of its two children
        std::uint32_t count = 0;  ///< number of triangles; 0 in inner nodes
    };

    static double to_box(const Point& p, const Node& node) {
        double sum = 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double d = std::max({node.low[axis] - p[axis], p[axis] - node.high[axis], 0.0});
            sum += d * d;
        }
        return sum;
    }

    void build(std::uint32_t node, std::uint32_t first, std::span<std::uint32_t> order,
               const std::vector<std::array<float, 3>>& centres) {
        if (order.size() <= 4) {
            nodes_[node].first = first;
            nodes_[node].count = static_cast<std::uint32_t>(order.size());
            return;
        }
        std::array<float, 3> low = centres[order[0]];
        std::array<float, 3> high = low;
        for (const std::uint32_t i : order) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], centres[i][axis]);
                high[axis] = std::max(high[axis], centres[i][axis]);
            }
        }
        std::size_t axis = 0;
        for (std::size_t other = 1; other < 3; ++other) {
            axis = high[other] - low[other] > high[axis] - low[axis] ? other : axis;
        }
        const std::size_t half = order.size() / 2;
        std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(half),
                         order.end(), [&](std::uint32_t a, std::uint32_t b) {
                             return std::pair(centres[a][axis], a) < std::pair(centres[b][axis], b);
                         });
        const auto child = static_cast<std::uint32_t>(nodes_.size());
        nodes_[node].first = child;
        nodes_.resize(nodes_.size() + 2);
        build(child, first, order.first(half), centres);
        build(child + 1, first + static_cast<std::uint32_t>(half), order.subspan(half), centres);
    }

    /// REQUIRES: its children have been fitted.
    void fit(Node& node) const {
        node.low.fill(std::numeric_limits<double>::infinity());
        node.high.fill(-std::numeric_limits<double>::infinity());
        const auto take = [&](const Point& low, const Point& high) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                node.low[axis] = std::min(node.low[axis], low[axis]);
                node.high[axis] = std::max(node.high[axis], high[axis]);
            }
        };
        for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
            for (const Point& p : corners_[i]) {
                take(p, p);
            }
        }
        for (std::uint32_t i = node.first; node.count == 0 && i < node.first + 2; ++i) {
            take(nodes_[i].low, nodes_[i].high);
        }
    }

    std::vector<Corners> corners_;
    std::vector<Node> nodes_;
};

}  // namespace bench
