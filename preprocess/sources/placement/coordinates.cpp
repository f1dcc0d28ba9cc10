#include "preprocess/sources/placement/coordinates.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

#include "preprocess/sources/placement/axis_units.h"

namespace isonest::detail {
namespace {

constexpr double kMostUneven = 0.1;     ///< of a step
constexpr double kLeastUneven = 0.001;  ///< of a step

struct Evenness {
    bool usable = false;  ///< the numbers are finite and not all the same
    double step = 1;      ///< the mean one; of one node 1
    double shift = 0;     ///< the largest distance of a number from its even place
    double rounding = 0;  ///< what rounding to float32 may shift
};

/// The largest distance of the coordinates from `from`, `from` + `step` and so on.
double most_shift(const std::vector<double>& numbers, double from, double step) {
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
    even.shift = most_shift(numbers, numbers.front(), even.step);
    even.usable =
        std::isfinite(even.step) && std::isfinite(even.shift) && (even.step != 0 || even.shift > 0);
    return even;
}

/// What is said of a spacing of the caller's, along an axis whose coordinates are not even.
std::string note_of_given(const AxisCoordinates& axis, const Evenness& even, double spacing,
                          double factor) {
    const double step = std::copysign(spacing, even.step) / factor;
    const double from =
        even.step < 0 ? axis.numbers.back() - step * static_cast<double>(axis.numbers.size() - 1)
                      : axis.numbers.front();
    return fmt::format(
        "the coordinates '{}' are not evenly spaced: with the spacing that is given, nodes lie up "
        "to {:.3g} away from theirs",
        axis.name, most_shift(axis.numbers, from, step));
}

}  // namespace

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
            place.notes.push_back(fmt::format("the coordinates '{}' {}: they place nothing",
                                              axis.name,
                                              std::all_of(axis.numbers.begin(), axis.numbers.end(),
                                                          [](double c) { return std::isfinite(c); })
                                                  ? "are all the same"
                                                  : "are not all numbers"));
            continue;
        }
        if (!common.places(a)) {
            continue;
        }
        const bool alone = axis.numbers.size() < 2;
        place.said.at(a) = !alone;
        place.step.at(a) = alone ? 1 : common.converted(a, e.step);
        place.first.at(a) = common.converted(a, axis.numbers.front());
        if (!(e.shift < kMostUneven * std::fabs(e.step))) {
            if (options.spacing) {
                place.notes.push_back(
                    note_of_given(axis, e, options.spacing->at(a), common.converted(a, 1)));
                // Coordinates that end where they begin have no mean step.
                place.step.at(a) = e.step == 0 ? 1 : place.step.at(a);
            } else if (uneven == nullptr) {
                uneven = &axis;
                how = &e;
            }
        } else if (e.shift > std::max(kLeastUneven * std::fabs(e.step), e.rounding) &&
                   !options.spacing) {
            place.notes.push_back(
                fmt::format("the coordinates '{}' are not quite evenly spaced: nodes lie up to "
                            "{:.3g}, {:.2g} of a step, away from theirs",
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
            fmt::format("the coordinates '{}' are not evenly spaced ({:.6g}, {:.6g}, ... {:.6g}): "
                        "with their mean spacing, {:.6g},{:.6g},{:.6g} (x,y,z), nodes would lie "
                        "up to {:.3g} away from theirs",
                        uneven->name, uneven->numbers[0], uneven->numbers[1],
                        uneven->numbers.back(), spacing[0], spacing[1], spacing[2], how->shift),
            {{RemedyKind::place_in_world, "spacing"}});
    }
    return place;
}

}  // namespace isonest::detail
