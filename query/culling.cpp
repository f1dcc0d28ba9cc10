#include "query/culling.h"

#include <algorithm>
#include <cmath>

namespace isonest {
namespace {

/// Relative to the largest slope: below it a gradient is rounding errors.
constexpr double kRounding = 1e-9;

double dot(const Double3& a, const Double3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Double3 cross(const Double3& a, const Double3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

}  // namespace

Culling::Culling(const Double3& view, Field field, const Double3& spacing)
    : view_(view), by_normal_(field == Field::normal_turn_plus), spacing_(spacing) {
    const double size = std::hypot(view[0], view[1], view[2]);
    for (double& v : view_) {
        v /= size;
    }
}

bool Culling::faces_away(const CubeValues& values, const TopologyTetrahedron& t, unsigned mirror,
                         std::int64_t stride, double beta) const {
    if (!std::isfinite(beta)) {
        return false;
    }
    std::array<Double3, 4> p{};
    for (std::size_t i = 0; i < 4; ++i) {
        const Int3 offset = node_offset(t.vertices[i], mirror);
        for (int axis = 0; axis < 3; ++axis) {
            const auto a = static_cast<std::size_t>(axis);
            p[i][a] = static_cast<double>(offset[axis] * stride) * spacing_[a];
        }
    }
    std::array<Double3, 3> e{};
    std::array<double, 3> du{};
    double steepest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t a = 0; a < 3; ++a) {
            e[i][a] = p[i + 1][a] - p[0][a];
        }
        du[i] = values[t.vertices[i + 1]] - values[t.vertices[0]];
        steepest = std::max(steepest, std::fabs(du[i]) / std::sqrt(dot(e[i], e[i])));
    }
    if (!std::isfinite(steepest)) {
        return false;
    }
    const double det = dot(e[0], cross(e[1], e[2]));
    const std::array<Double3, 3> columns{cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])};
    Double3 g{};
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t a = 0; a < 3; ++a) {
            g[a] += columns[i][a] * du[i] / det;
        }
    }
    const double along = dot(g, view_);
    if (!by_normal_) {
        return along + beta <= -kRounding * (steepest + beta);
    }
    const double size = std::sqrt(dot(g, g));
    return size > kRounding * steepest && along / size + beta <= -kRounding;
}

}  // namespace isonest
