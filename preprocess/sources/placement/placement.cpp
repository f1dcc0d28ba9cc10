#include "preprocess/sources/placement/placement.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

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

double degrees(double cosine) {
    return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
}

/// "x and z meet at 71.5 degrees": of the two axes that are furthest from a right angle.
std::string sheared_axes(const Int3& nodes, const std::array<Double3, 3>& steps) {
    double worst = 0;
    std::string text;
    for (std::size_t a = 0; a < 2; ++a) {
        for (std::size_t b = a + 1; b < 3; ++b) {
            const double angle = degrees(dot(steps.at(a), steps.at(b)) /
                                         (length_of(steps.at(a)) * length_of(steps.at(b))));
            constexpr double kRight = 90;
            const bool flat = nodes[static_cast<int>(a)] == 1 || nodes[static_cast<int>(b)] == 1;
            if (!flat && std::fabs(angle - kRight) > worst) {
                worst = std::fabs(angle - kRight);
                text = fmt::format("{} and {} meet at {:.4g} degrees", "xyz"[a], "xyz"[b], angle);
            }
        }
    }
    return text;
}

/// From the world's axes to these, degrees.
double turn_of(const Directions& d) {
    return degrees((d[0][0] + d[1][1] + d[2][2] - 1) / 2);
}

/// How far nodes lie from where spacings along the directions put them, added up over the axes.
double shift_from(const Int3& nodes, const std::array<Double3, 3>& steps,
                  const Directions& direction) {
    double shift = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const Double3 straight = times(direction.at(a), -length_of(steps.at(a)));
        shift += length_of(sum(steps.at(a), straight)) * cells_along(nodes, a);
    }
    return shift;
}

std::string lost_text(const std::vector<std::string>& lost) {
    return lost.empty() ? ""
                        : fmt::format(
                              "the spacing that was given replaces the directions of the "
                              "file, which are lost: {}",
                              fmt::join(lost, "; "));
}

std::string text_of_turn(const Directions& direction) {
    return fmt::format("a rotation by {:.4g} degrees", turn_of(direction));
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

std::string lost_by_own_spacing(const Directions& direction) {
    return direction == kAlongWorld ? "" : lost_text({text_of_turn(direction)});
}

std::string lost_by_own_spacing(const Int3& nodes, std::array<Double3, 3> steps) {
    complete_steps(nodes, steps);
    double lengths = 1;
    for (const Double3& step : steps) {
        lengths *= length_of(step);
    }
    const double spanned = dot(cross(steps[0], steps[1]), steps[2]);
    constexpr double kFlat = 1e-6;
    if (!(lengths > 0) || !std::isfinite(lengths) || !(std::fabs(spanned) > kFlat * lengths)) {
        return "";
    }
    std::vector<std::string> lost;
    if (is_along_world(nodes, steps)) {
        std::string backward;
        for (std::size_t a = 0; a < 3; ++a) {
            if (steps.at(a).at(a) < 0 && nodes[static_cast<int>(a)] > 1) {
                backward += fmt::format("{}{}", backward.empty() ? "" : ", ", "xyz"[a]);
            }
        }
        if (!backward.empty()) {
            lost.push_back("these axes run backward, and are not turned around: " + backward);
        }
        return lost_text(lost);
    }
    if (spanned < 0) {
        lost.emplace_back("the axes are left-handed, so the volume becomes its mirror image");
        steps[0] = times(steps[0], -1);
    }
    const Directions direction = orthonormal(nodes, steps);
    if (turn_of(direction) > 0.01) {
        lost.push_back(text_of_turn(direction));
    }
    const double least = std::min({length_of(steps[0]), length_of(steps[1]), length_of(steps[2])});
    if (!(shift_from(nodes, steps, direction) < kMostShift * least)) {
        lost.push_back("a shear (" + sheared_axes(nodes, steps) + ")");
    }
    return lost_text(lost);
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
    if (!(shift_from(nodes, steps, place.direction) < kMostShift * least)) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("a sheared volume: {}, with the spacing {:.6g},{:.6g},{:.6g}; "
                                "resample it. With a spacing of your own the axes are taken as at "
                                "right angles, and the shear{} is lost",
                                sheared_axes(nodes, steps), place.spacing[0], place.spacing[1],
                                place.spacing[2],
                                turn_of(place.direction) > 0.01
                                    ? fmt::format(", with the rotation by {:.4g} degrees,",
                                                  turn_of(place.direction))
                                    : ""),
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
