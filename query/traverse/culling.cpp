#include "query/traverse/culling.h"

#include <algorithm>
#include <cmath>

#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

/// Relative to the terms of its sum: below it a gradient is rounding errors.
constexpr double kRounding = 1e-9;

}  // namespace

Culling::Culling(const Double3& view, Field field, const Double3& spacing)
    : by_normal_(field == Field::normal_turn_plus) {
    for (unsigned mirror = 0; mirror < view_.size(); ++mirror) {
        for (unsigned a = 0; a < 3; ++a) {
            view_[mirror][a] = view[a] / length(view) * ((mirror >> a & 1U) != 0 ? -1 : 1);
        }
    }
    const auto add = [&](const TopologyTetrahedron& t) {
        Simplex simplex;
        for (std::size_t i = 0; i < 4; ++i) {
            const Int3 node = node_offset(t.vertices[i], 0);
            for (int axis = 0; axis < 3; ++axis) {
                const auto a = static_cast<std::size_t>(axis);
                simplex.v[i][a] = static_cast<double>(node[axis]) * spacing[a];
            }
        }
        Weights& weights = weights_[t.number];
        const std::array<Double3, 4> all = simplex.gradient_weights();
        for (std::size_t i = 0; i < 3; ++i) {
            weights.row[i] = all[i + 1];
            weights.size = std::max(weights.size, length(all[i + 1]));
        }
    };
    const Topology& tables = topology();
    std::for_each(tables.cube.begin(), tables.cube.end(), add);
    std::for_each(tables.face.begin(), tables.face.end(), add);
    std::for_each(tables.edge.begin(), tables.edge.end(), add);
    for (const auto& subcube : tables.subcube) {
        std::for_each(subcube.begin(), subcube.end(), add);
    }
}

bool Culling::faces_away(const CubeValues& values, const TopologyTetrahedron& t, unsigned mirror,
                         std::int64_t stride, double beta) const {
    const Weights& weights = weights_[t.number];
    Double3 g{};
    double largest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double du = values[t.vertices[i + 1]] - values[t.vertices[0]];
        for (std::size_t a = 0; a < 3; ++a) {
            g[a] += weights.row[i][a] * du;
        }
        largest += std::fabs(du);
    }
    const double along = dot(g, view_[mirror]);
    if (!(along < 0) || !std::isfinite(largest) || !std::isfinite(beta)) {
        return false;
    }
    const double rounding = kRounding * largest * weights.size;
    if (!by_normal_) {
        // g and the rounding are those of stride 1.
        const auto by = static_cast<double>(stride);
        return along / by + beta <= -(rounding / by + kRounding * beta);
    }
    const double size = length(g);
    return size > rounding && along / size + beta <= -kRounding;
}

}  // namespace isonest::detail
