#include "query/traverse/interest.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <isonest/error.h>

#include "store/base/vectors.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {

namespace {

LatticePlane even_plane(const StoreHeader& header, const WorldPlane& world) {
    LatticePlane plane{header.steps().changes(world.normal), world.offset};
    for (std::size_t a = 0; a < 3; ++a) {
        plane.offset -= world.normal[a] * header.origin[a];
    }
    return plane;
}

/// In lattice coordinates, only planes across an axis are planes. Throws Error{unsupported} for
/// others.
LatticePlane uneven_plane(const StoreHeader& header, const WorldPlane& world) {
    const auto across =
        std::count_if(world.normal.begin(), world.normal.end(), [](double n) { return n != 0; });
    if (across > 1) {
        require_even_axes(header, {}, "a plane that is not across one of the axes");
    }
    LatticePlane plane{{0, 0, 0}, 0};
    for (std::size_t a = 0; a < 3; ++a) {
        if (const double n = world.normal[a]; n != 0) {
            plane.normal[a] = n;
            plane.offset = n * header.steps().place(a, world.offset / n - header.origin[a]);
        }
    }
    return plane;
}

}  // namespace

LatticePlane lattice_plane(const StoreHeader& header, const WorldPlane& world) {
    require_not_curved(header, {}, "a plane");
    LatticePlane plane = header.uneven ? uneven_plane(header, world) : even_plane(header, world);
    double size = 0;
    double low = 0;  // minimum of n . p over the volume
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        size += std::fabs(world.normal[a]);
        low += std::min(0.0, plane.normal[a] * static_cast<double>(header.nodes[axis] - 1));
    }
    if (!(size > 0) || !std::isfinite(size) || !std::isfinite(world.offset)) {
        throw Error(ErrorKind::invalid_argument,
                    "plane: the normal must be finite and not zero, the offset finite");
    }
    if (low >= plane.offset) {
        for (double& n : plane.normal) {
            n = -n;
        }
        plane.offset = -plane.offset;
    }
    return plane;
}

namespace {

/// Relative to the terms of its sum: a smaller gradient is only rounding error.
constexpr double kRounding = 1e-9;

}  // namespace

Culling::Culling(const Double3& view, Field field, const LatticeSteps& steps)
    : by_normal_(field == Field::normal_turn_plus), steps_(steps) {
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
                simplex.v[i][a] = static_cast<double>(node[axis]) * steps.along[a];
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
    if (steps_.is_sheared()) {
        // The mirror image has a different shape.
        for (std::size_t a = 0; a < 3; ++a) {
            g[a] = (mirror >> a & 1U) != 0 ? -g[a] : g[a];
        }
        g = steps_.gradient(g);
    }
    const double along = dot(g, view_[steps_.is_sheared() ? 0 : mirror]);
    if (!(along < 0) || !std::isfinite(largest) || !std::isfinite(beta)) {
        return false;
    }
    const double rounding = kRounding * largest * weights.size;
    if (!by_normal_) {
        // g and the rounding are for stride 1.
        const auto by = static_cast<double>(stride);
        return along / by + beta <= -(rounding / by + kRounding * beta);
    }
    const double size = length(g);
    return size > rounding && along / size + beta <= -kRounding;
}

Tolerance::Tolerance(double threshold, const std::optional<Focus>& focus,
                     const std::optional<Camera>& camera, const LatticeSteps& steps,
                     const Double3& origin)
    : threshold_(threshold),
      focus_(focus),
      camera_(camera),
      varies_(focus || camera),
      steps_(steps),
      origin_(origin) {
    const double longest = steps.longest();
    diagonal_ = steps.diagonal();
    // From a centre to a face centre, from there to an edge midpoint (one step each), from there to
    // a centre of half the scale (half a diagonal), and so on: (2 steps + diagonal / 2) (1 + 1/2 +
    // 1/4 ...). Slightly enlarged, so that rounding does not matter.
    constexpr double kMore = 1.01;
    step_ = kMore * longest;
    reach_ = 4 * step_ + kMore * diagonal_;
    if (camera_) {
        pixel_ = 2 * std::tan(camera_->field_of_view * std::numbers::pi / 360) /
                 static_cast<double>(camera_->height);
    }
}

double Tolerance::at(const Int3& twice, std::int64_t half_scale) const {
    const double scale = static_cast<double>(half_scale) / 2;
    Double3 p = steps_.vector({static_cast<double>(twice.x) / 2, static_cast<double>(twice.y) / 2,
                               static_cast<double>(twice.z) / 2});
    int odd = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        odd += static_cast<int>((twice[axis] / half_scale) & 1);
        p[a] = origin_[a] + p[a];
    }
    const double radius = (reach_ - (3 - odd) * step_) * scale;
    double threshold = threshold_;
    if (focus_) {
        Double3 away{};
        for (std::size_t a = 0; a < 3; ++a) {
            away[a] = std::max({focus_->lo[a] - p[a], p[a] - focus_->hi[a], 0.0});
        }
        const double distance = std::max(hypot3(away[0], away[1], away[2]) - radius, 0.0);
        threshold *= 1 + focus_->falloff * distance;
    }
    if (camera_) {
        const Double3& eye = camera_->position;
        const double distance = hypot3(p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]) - radius;
        if (distance > 0 && 2 * scale * diagonal_ < camera_->pixels * pixel_ * distance) {
            return std::numeric_limits<double>::infinity();
        }
    }
    return threshold;
}

}  // namespace isonest::detail
