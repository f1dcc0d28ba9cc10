#include "preprocess/sources/placement/placement.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/base/vectors.h"
#include "store/container/format.h"

namespace isonest::detail {

std::vector<std::string> note_of_spacing(const std::array<bool, 3>& said, const Int3& nodes,
                                         const SourceOptions& options) {
    if (options.spacing) {
        return {};
    }
    std::string unsaid;
    bool partly = false;
    for (std::size_t a = 0; a < 3; ++a) {
        if (nodes[static_cast<int>(a)] == 1) {
            continue;
        }
        if (said.at(a)) {
            partly = true;
        } else {
            unsaid += fmt::format("{}{}", unsaid.empty() ? "" : " and ", "xyz"[a]);
        }
    }
    if (unsaid.empty()) {
        return {};
    }
    return {fmt::format("the file does not give the spacing{}{}; it is taken as 1",
                        partly ? " along " : "", partly ? unsaid : "")};
}

std::unique_ptr<VolumeSource> without_spacing(std::unique_ptr<VolumeSource> inner,
                                              const SourceOptions& options) {
    const Int3 nodes = inner->describe().nodes;
    return with_notes(std::move(inner), note_of_spacing({}, nodes, options));
}

namespace {

constexpr double kMaxShift = 0.1;  ///< in voxels

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

/// A vector at a right angle to `v`: the most nearly perpendicular world axis, from `first` on,
/// made exact. That axis itself if `v` is zero.
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
        if (!(shift < kMaxShift * length_of(steps.at(world)))) {
            return false;
        }
    }
    return true;
}

/// Gram-Schmidt, beginning with the longest axis, whose steps move distant samples most.
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

/// The angle between the world's axes and these, in degrees.
double turn_of(const Directions& d) {
    return degrees((d[0][0] + d[1][1] + d[2][2] - 1) / 2);
}

/// How far nodes are from where spacings along the directions put them, summed over the axes.
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
                              "the given spacing replaces the axis directions of the file, so "
                              "these are lost: {}",
                              fmt::join(lost, "; "));
}

std::string text_of_turn(const Directions& direction) {
    return fmt::format("a rotation by {:.4g} degrees", turn_of(direction));
}

/// Makes the steps along axes of one node perpendicular to the other steps.
void straighten_flat_axes(const Int3& nodes, std::array<Double3, 3>& steps) {
    std::array<Double3, 3> others = steps;
    for (std::size_t a = 0; a < 3; ++a) {
        others.at(a) = nodes[static_cast<int>(a)] == 1 ? Double3{} : steps.at(a);
    }
    complete_steps(nodes, others);
    for (std::size_t a = 0; a < 3; ++a) {
        if (nodes[static_cast<int>(a)] == 1) {
            const double along = dot(others.at(a), steps.at(a)) < 0 ? -1 : 1;
            steps.at(a) = times(others.at(a), along * length_of(steps.at(a)));
        }
    }
}

/// "a shear (...)".
std::string text_of_shear(const Int3& nodes, const std::array<Double3, 3>& axes) {
    return "a shear (" + sheared_axes(nodes, axes) + ")";
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
    std::vector<std::string> lost;
    if (const Directions turn = own_directions(direction); turn != kAlongWorld) {
        lost.push_back(text_of_turn(turn));
    }
    if (!are_directions(direction)) {
        constexpr Int3 kSeveral{2, 2, 2};
        lost.push_back(text_of_shear(kSeveral, direction));
    }
    return lost_text(lost);
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
            lost.push_back("the reversed direction of the axes " + backward);
        }
        return lost_text(lost);
    }
    if (spanned < 0) {
        lost.emplace_back("the handedness of the axes (left-handed), so the volume is mirrored");
        steps[0] = times(steps[0], -1);
    }
    const Directions direction = orthonormal(nodes, steps);
    if (turn_of(direction) > 0.01) {
        lost.push_back(text_of_turn(direction));
    }
    const double least = std::min({length_of(steps[0]), length_of(steps[1]), length_of(steps[2])});
    if (!(shift_from(nodes, steps, direction) < kMaxShift * least)) {
        lost.push_back(text_of_shear(nodes, steps));
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
                        fmt::format("invalid placement along {}: the step between samples is ({}, "
                                    "{}, {}), and the first sample is at ({}, {}, {})",
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
    const double least = std::min({place.spacing[0], place.spacing[1], place.spacing[2]});
    const auto is_orthogonal = [&] {
        place.direction = orthonormal(nodes, steps);
        return shift_from(nodes, steps, place.direction) < kMaxShift * least;
    };
    if (is_orthogonal()) {
        return place;
    }
    straighten_flat_axes(nodes, steps);
    if (is_orthogonal()) {
        return place;
    }
    for (std::size_t a = 0; a < 3; ++a) {
        place.direction.at(a) = times(steps.at(a), 1 / place.spacing.at(a));
    }
    if (!span_space(place.direction)) {
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format(
                "the axes lie nearly in one plane: {}, with the spacing {:.6g},{:.6g},{:.6g}; if "
                "you give a spacing, the axes are taken to be at right angles",
                sheared_axes(nodes, steps), place.spacing[0], place.spacing[1], place.spacing[2]),
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

namespace {

constexpr double kMaxUneven = 0.1;    ///< in steps
constexpr double kMinUneven = 0.001;  ///< in steps

struct Evenness {
    bool usable = false;  ///< the numbers are finite and not all equal
    double step = 1;      ///< mean step; 1 for a single node
    double shift = 0;     ///< maximum distance of a number from its evenly spaced place
    double rounding = 0;  ///< maximum shift caused by rounding to float32
};

/// The maximum distance of the coordinates from `from`, `from` + `step` and so on.
double max_shift(const std::vector<double>& numbers, double from, double step) {
    double most = 0;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        most = std::max(most, std::fabs(numbers[i] - from - static_cast<double>(i) * step));
    }
    return most;
}

Evenness evenness_of(const std::vector<double>& numbers) {
    Evenness even;
    double largest = 0;
    for (const double number : numbers) {
        if (!std::isfinite(number)) {
            return even;
        }
        largest = std::max(largest, std::fabs(number));
    }
    if (numbers.size() < 2) {
        even.usable = !numbers.empty();
        return even;
    }
    constexpr double kOfFloat = 0x1p-23;  // twice half a unit in the last place
    even.rounding = largest * kOfFloat;
    even.step = (numbers.back() - numbers.front()) / static_cast<double>(numbers.size() - 1);
    even.shift = max_shift(numbers, numbers.front(), even.step);
    even.usable =
        std::isfinite(even.step) && std::isfinite(even.shift) && (even.step != 0 || even.shift > 0);
    return even;
}

/// The note about a caller's spacing along an axis with uneven coordinates.
std::string note_of_given(const AxisCoordinates& axis, const Evenness& even, double spacing,
                          double factor) {
    const double step = std::copysign(spacing, even.step) / factor;
    const double from =
        even.step < 0 ? axis.numbers.back() - step * static_cast<double>(axis.numbers.size() - 1)
                      : axis.numbers.front();
    return fmt::format(
        "the coordinates '{}' are not evenly spaced; with the given spacing, nodes are up to "
        "{:.3g} away from their coordinates",
        axis.name, max_shift(axis.numbers, from, step));
}

bool is_monotonic(const std::vector<double>& numbers) {
    const auto falls = [](double a, double b) { return !(a < b); };
    const auto rises = [](double a, double b) { return !(a > b); };
    return std::adjacent_find(numbers.begin(), numbers.end(), falls) == numbers.end() ||
           std::adjacent_find(numbers.begin(), numbers.end(), rises) == numbers.end();
}

class UnevenSource : public DescribedSource {
  public:
    /// `first`: where node 0 lies along the axes with offsets.
    UnevenSource(std::unique_ptr<VolumeSource> inner, UnevenAxesPtr axes, const Double3& first)
        : DescribedSource(std::move(inner)), described_(inner_source().describe()) {
        for (std::size_t a = 0; a < 3; ++a) {
            if (const std::vector<double>& offsets = axes->offsets.at(a); !offsets.empty()) {
                described_.origin.at(a) = first.at(a);
                described_.spacing.at(a) = offsets.back() / static_cast<double>(offsets.size() - 1);
            }
        }
        described_.uneven = std::move(axes);
        if (const std::string why =
                why_not_uneven(described_.nodes, described_.spacing, described_.origin,
                               described_.direction, described_.uneven);
            !why.empty()) {
            throw Error(ErrorKind::unsupported, {described_.name}, why,
                        {{RemedyKind::place_in_world, "spacing"}});
        }
    }
    [[nodiscard]] VolumeDescription describe() const override { return described_; }

  private:
    VolumeDescription described_;
};

class PositionedSource : public DescribedSource {
  public:
    PositionedSource(std::unique_ptr<VolumeSource> inner, NodePositionsPtr positions)
        : DescribedSource(std::move(inner)), described_(inner_source().describe()) {
        const Int3& n = described_.nodes;
        if (std::min({n.x, n.y, n.z}) < 2) {
            throw Error(ErrorKind::unsupported, {described_.name},
                        fmt::format("a curvilinear grid of {} x {} x {} nodes is not supported: it "
                                    "needs at least two along each axis",
                                    n.x, n.y, n.z),
                        {{RemedyKind::place_in_world, "spacing"}});
        }
        for (const auto& coordinate : positions->coordinates) {
            const VolumeDescription of = coordinate->describe();
            if (of.nodes != n) {
                throw Error(ErrorKind::corrupt, {of.name},
                            fmt::format("positions of {} x {} x {} nodes, but the volume has {} x "
                                        "{} x {}",
                                        of.nodes.x, of.nodes.y, of.nodes.z, n.x, n.y, n.z));
            }
        }
        described_.spacing = {1, 1, 1};
        described_.origin = {0, 0, 0};
        described_.direction = kAlongWorld;
        described_.uneven = nullptr;
        described_.curved = std::move(positions);
    }
    [[nodiscard]] VolumeDescription describe() const override { return described_; }

  private:
    VolumeDescription described_;
};

}  // namespace

std::unique_ptr<VolumeSource> with_positions(std::unique_ptr<VolumeSource> inner,
                                             NodePositionsPtr positions) {
    return std::make_unique<PositionedSource>(std::move(inner), std::move(positions));
}

std::unique_ptr<VolumeSource> with_uneven_axes(std::unique_ptr<VolumeSource> inner,
                                               UnevenAxesPtr axes) {
    if (!axes) {
        return inner;
    }
    const Double3 first = inner->describe().origin;
    return std::make_unique<UnevenSource>(std::move(inner), std::move(axes), first);
}

std::unique_ptr<VolumeSource> with_uneven_axes(std::unique_ptr<VolumeSource> inner,
                                               UnevenCoordinates coordinates) {
    const VolumeDescription described = inner->describe();
    auto axes = std::make_shared<UnevenAxes>();
    Double3 first{};
    for (std::size_t a = 0; a < 3; ++a) {
        std::vector<double>& at = coordinates.at(a);
        if (at.empty()) {
            continue;
        }
        std::sort(at.begin(), at.end());
        if (described.direction.at(a).at(a) < 0) {
            std::reverse(at.begin(), at.end());
        }
        first.at(a) = at.front();
        for (double& x : at) {
            x = std::fabs(x - first.at(a));
        }
        axes->offsets.at(a) = std::move(at);
    }
    if (*axes == UnevenAxes()) {
        return inner;
    }
    return std::make_unique<UnevenSource>(std::move(inner), std::move(axes), first);
}

CoordinatePlace place_by_coordinates(const std::array<std::optional<AxisCoordinates>, 3>& axes,
                                     const Int3& nodes, const SourceOptions& options,
                                     const std::string& name) {
    std::array<Evenness, 3> even{};
    AxisUnits units;
    for (std::size_t a = 0; a < 3; ++a) {
        if (axes.at(a)) {
            even.at(a) = evenness_of(axes.at(a)->numbers);
            units.at(a) =
                counted_unit(nodes[static_cast<int>(a)], even.at(a).usable ? axes.at(a)->unit : "");
        }
    }
    const CommonUnit common = common_unit(units);
    CoordinatePlace place;
    place.unit = common.unit;
    place.notes = common.notes;
    const AxisCoordinates* uneven = nullptr;
    const Evenness* how = nullptr;
    for (std::size_t a = 0; a < 3; ++a) {
        if (!axes.at(a) || axes.at(a)->numbers.empty()) {
            continue;
        }
        const AxisCoordinates& axis = *axes.at(a);
        const Evenness& e = even.at(a);
        if (!e.usable) {
            place.notes.push_back(fmt::format("the coordinates '{}' {}; they are ignored",
                                              axis.name,
                                              std::all_of(axis.numbers.begin(), axis.numbers.end(),
                                                          [](double c) { return std::isfinite(c); })
                                                  ? "are all the same"
                                                  : "are not all finite numbers"));
            continue;
        }
        if (!common.places(a)) {
            continue;
        }
        const bool alone = axis.numbers.size() < 2;
        place.said.at(a) = !alone;
        place.step.at(a) = alone ? 1 : common.converted(a, e.step);
        place.first.at(a) = common.converted(a, axis.numbers.front());
        if (!(e.shift < kMaxUneven * std::fabs(e.step))) {
            if (options.spacing) {
                place.notes.push_back(
                    note_of_given(axis, e, options.spacing->at(a), common.converted(a, 1)));
                // Coordinates that end where they begin have no mean step.
                place.step.at(a) = e.step == 0 ? 1 : place.step.at(a);
            } else if (is_monotonic(axis.numbers)) {
                place.uneven.at(a).resize(axis.numbers.size());
                std::transform(axis.numbers.begin(), axis.numbers.end(), place.uneven.at(a).begin(),
                               [&](double x) { return common.converted(a, x); });
            } else if (uneven == nullptr) {
                uneven = &axis;
                how = &e;
            }
        } else if (e.shift > std::max(kMinUneven * std::fabs(e.step), e.rounding) &&
                   !options.spacing) {
            place.notes.push_back(
                fmt::format("the coordinates '{}' are not quite evenly spaced; nodes are up to "
                            "{:.3g} ({:.2g} of a step) away from their coordinates",
                            axis.name, e.shift, e.shift / std::fabs(e.step)));
        }
    }
    if (uneven != nullptr) {
        std::array<double, 3> spacing{};
        for (std::size_t a = 0; a < 3; ++a) {
            spacing.at(a) = place.step.at(a) == 0 ? 1 : std::fabs(place.step.at(a));
        }
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format("the coordinates '{}' neither increase nor decrease throughout ({:.6g}, "
                        "{:.6g}, ... {:.6g}); "
                        "with their mean spacing, {:.6g},{:.6g},{:.6g} (x,y,z), nodes would be up "
                        "to {:.3g} away from their coordinates",
                        uneven->name, uneven->numbers[0], uneven->numbers[1],
                        uneven->numbers.back(), spacing[0], spacing[1], spacing[2], how->shift),
            {{RemedyKind::place_in_world, "spacing"}});
    }
    return place;
}

}  // namespace isonest::detail
