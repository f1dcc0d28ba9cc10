#include "preprocess/sources/placement/placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

#include "store/base/rotation.h"

namespace isonest::detail {
namespace {

constexpr double kMostShift = 0.1;  ///< of a voxel

double length_of(const Double3& a) {
    return std::hypot(a[0], a[1], a[2]);
}
Double3 times(const Double3& a, double factor) {
    return {a[0] * factor, a[1] * factor, a[2] * factor};
}
Double3 sum(const Double3& a, const Double3& b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

double cells_along(const Int3& nodes, std::size_t axis) {
    return static_cast<double>(std::max<std::int64_t>(nodes[static_cast<int>(axis)] - 1, 1));
}

/// At a right angle to `v`: of the world's axes from `first` on, the one that is most so, made
/// exact. That axis itself if `v` is zero.
Double3 perpendicular(const Double3& v, std::size_t first) {
    const double length = length_of(v);
    std::size_t best = first;
    for (std::size_t i = 1; i < 3; ++i) {
        const std::size_t axis = (first + i) % 3;
        best = std::fabs(v.at(axis)) < std::fabs(v.at(best)) ? axis : best;
    }
    Double3 normal{0, 0, 0};
    normal.at(best) = 1;
    return length > 0 ? sum(normal, times(v, -v.at(best) / (length * length))) : normal;
}

bool is_along_world(const Int3& nodes, const std::array<Double3, 3>& steps) {
    for (std::size_t world = 0; world < 3; ++world) {
        double shift = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            const double along =
                a == world ? std::copysign(length_of(steps.at(a)), steps.at(a).at(world)) : 0;
            shift += std::fabs(steps.at(a).at(world) - along) * cells_along(nodes, a);
        }
        if (!(shift < kMostShift * length_of(steps.at(world)))) {
            return false;
        }
    }
    return true;
}

/// By Gram and Schmidt, from the longest axis on, whose steps move the far samples most.
Directions orthonormal(const Int3& nodes, const std::array<Double3, 3>& steps) {
    std::array<std::size_t, 3> order{0, 1, 2};
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return cells_along(nodes, a) > cells_along(nodes, b);
    });
    Directions direction{};
    for (std::size_t i = 0; i < 3; ++i) {
        Double3 v = steps.at(order.at(i));
        for (std::size_t j = 0; j < i; ++j) {
            const Double3& u = direction.at(order.at(j));
            v = sum(v, times(u, -dot(u, v)));
        }
        direction.at(order.at(i)) = times(v, 1 / length_of(v));
    }
    return direction;
}

}  // namespace

void complete_steps(const Int3& nodes, std::array<Double3, 3>& steps) {
    for (std::size_t a = 0; a < 3; ++a) {
        if (nodes[static_cast<int>(a)] > 1 || length_of(steps.at(a)) > 0) {
            continue;
        }
        const Double3& b = steps.at((a + 1) % 3);
        const Double3& c = steps.at((a + 2) % 3);
        Double3 normal = cross(b, c);
        if (!(length_of(normal) > 0)) {
            normal = perpendicular(length_of(b) > 0 ? b : c, a);
        }
        steps.at(a) = times(normal, 1 / length_of(normal));
    }
}

Placement place_in_world(const Int3& nodes, std::array<Double3, 3> steps, const Double3& first,
                         const std::string& name) {
    complete_steps(nodes, steps);
    for (std::size_t a = 0; a < 3; ++a) {
        const double length = length_of(steps.at(a));
        if (!(length > 0) || !std::isfinite(length) || !std::isfinite(first.at(a))) {
            throw Error(ErrorKind::corrupt, {name},
                        fmt::format("along {} the step from a sample to the next is ({}, {}, {}), "
                                    "the first one lies at ({}, {}, {})",
                                    "xyz"[a], steps.at(a)[0], steps.at(a)[1], steps.at(a)[2],
                                    first[0], first[1], first[2]),
                        {{RemedyKind::place_in_world, "spacing"}});
        }
    }
    Placement place;
    place.origin = first;
    for (std::size_t a = 0; a < 3; ++a) {
        place.spacing.at(a) = length_of(steps.at(a));
    }
    if (is_along_world(nodes, steps)) {
        for (std::size_t a = 0; a < 3; ++a) {
            place.backward.at(a) = steps.at(a).at(a) < 0;
            if (place.backward.at(a)) {
                place.origin.at(a) -=
                    place.spacing.at(a) * static_cast<double>(nodes[static_cast<int>(a)] - 1);
            }
        }
        return place;
    }
    if (dot(cross(steps[0], steps[1]), steps[2]) < 0) {
        place.backward[0] = true;
        place.origin = sum(place.origin, times(steps[0], static_cast<double>(nodes.x - 1)));
        steps[0] = times(steps[0], -1);
    }
    place.direction = orthonormal(nodes, steps);
    const double least = std::min({place.spacing[0], place.spacing[1], place.spacing[2]});
    double shift = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const Double3 straight = times(place.direction.at(a), -place.spacing.at(a));
        shift += length_of(sum(steps.at(a), straight)) * cells_along(nodes, a);
    }
    if (!(shift < kMostShift * least)) {
        throw Error(ErrorKind::unsupported, {name},
                    "a sheared volume: its axes are not at right angles to each other (samples lie "
                    "a tenth of a voxel or more beside); resample it, or ignore its directions",
                    {{RemedyKind::place_in_world, "spacing"}});
    }
    return place;
}

Placement with_z_as_it_runs(const Placement& place, const Int3& nodes) {
    if (!place.backward[2]) {
        return place;
    }
    Placement result = place;
    result.backward[2] = false;
    result.backward[0] = !place.backward[0];
    result.direction = {{{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}}};
    result.origin[0] += place.spacing[0] * static_cast<double>(nodes.x - 1);
    result.origin[2] += place.spacing[2] * static_cast<double>(nodes.z - 1);
    return result;
}

}  // namespace isonest::detail
