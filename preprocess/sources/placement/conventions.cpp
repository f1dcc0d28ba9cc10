#include "preprocess/sources/placement/conventions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include <isonest/error.h>

namespace isonest::detail {

Scaling cf_scaling(const NumbersOfAttribute& attribute, const std::string& name) {
    Scaling scaling;
    const auto one = [&](const char* key, double otherwise) {
        const std::vector<double> numbers = attribute(key);
        if (numbers.size() > 1) {
            throw Error(ErrorKind::corrupt, {name, key},
                        fmt::format("{} numbers instead of one", numbers.size()));
        }
        return numbers.empty() ? otherwise : numbers.front();
    };
    scaling.slope = one("scale_factor", 1);
    scaling.intercept = one("add_offset", 0);
    for (const char* const key : {"_FillValue", "missing_value"}) {
        for (const double number : attribute(key)) {
            // NaN is always missing.
            if (!std::isnan(number) && std::find(scaling.missing.begin(), scaling.missing.end(),
                                                 number) == scaling.missing.end()) {
                scaling.missing.push_back(number);
            }
        }
    }
    scaling.min_valid = one("valid_min", -HUGE_VAL);
    scaling.max_valid = one("valid_max", HUGE_VAL);
    if (const std::vector<double> range = attribute("valid_range"); range.size() == 2) {
        scaling.min_valid = range[0];
        scaling.max_valid = range[1];
    }
    return scaling;
}

void take_as_unsigned(std::vector<double>& numbers, std::size_t bytes) {
    const double all = std::ldexp(1.0, static_cast<int>(8 * bytes));
    for (double& number : numbers) {
        number += number < 0 ? all : 0;
    }
}

void unpack(std::vector<double>& coordinates, const NumbersOfAttribute& attribute) {
    const auto one = [&](const char* key, double otherwise) {
        const std::vector<double> numbers = attribute(key);
        return numbers.size() == 1 ? numbers.front() : otherwise;
    };
    const double scale = one("scale_factor", 1);
    const double offset = one("add_offset", 0);
    if (!std::isfinite(scale) || !std::isfinite(offset) || scale == 0) {
        return;
    }
    for (double& coordinate : coordinates) {
        coordinate = coordinate * scale + offset;
    }
}

namespace {

/// 0 to 2 for x, y and z; none for other dimensions.
std::optional<std::size_t> world_axis(const std::string& name) {
    for (std::size_t a = 0; a < 3; ++a) {
        if (name.size() == 6 && name[0] == "xyz"[a] && name.ends_with("space")) {
            return a;
        }
    }
    return std::nullopt;
}

std::optional<LengthUnit> unit_of(const std::vector<MincDimension>& dims) {
    std::optional<LengthUnit> unit;
    for (const MincDimension& dim : dims) {
        if (!world_axis(dim.name)) {
            continue;
        }
        const auto said = dim.units.empty() ? LengthUnit::millimetre : length_unit_from(dim.units);
        if (!said || (unit && unit != said)) {
            return std::nullopt;
        }
        unit = said;
    }
    return unit;
}

void take_all_of(ValueType stored, SliceScaling& scaling) {
    dispatch(stored, [&](auto tag) {
        using T = typename decltype(tag)::type;
        scaling.least = static_cast<double>(std::numeric_limits<T>::lowest());
        scaling.most = static_cast<double>(std::numeric_limits<T>::max());
    });
}

}  // namespace

MincPlace minc_place(const std::vector<MincDimension>& dims, bool with_spacing,
                     const std::string& name) {
    MincPlace place;
    place.unit = unit_of(dims);
    for (const MincDimension& dim : dims) {
        const auto world = world_axis(dim.name);
        place.axes.push_back({dim.name, dim.length, world.has_value()});
        place.steps.push_back({0, 0, 0});
        place.said.push_back(world && !dim.step.empty());
        if (!world) {
            continue;
        }
        if (dim.spacing.starts_with("irregular") && !with_spacing) {
            throw Error(
                ErrorKind::unsupported, {name},
                fmt::format("the spacing along {} is irregular, according to MINC", dim.name),
                {{RemedyKind::place_in_world, "spacing"}});
        }
        Double3 along{0, 0, 0};
        along.at(*world) = 1;
        if (dim.cosines.size() == 3) {
            std::copy(dim.cosines.begin(), dim.cosines.end(), along.begin());
        }
        const double step = dim.step.empty() ? 1 : dim.step.front();
        const double start = dim.start.empty() ? 0 : dim.start.front();
        for (std::size_t w = 0; w < 3; ++w) {
            place.steps.back().at(w) = step * along.at(w);
            place.first.at(w) += start * along.at(w);
        }
    }
    return place;
}

SliceScaling minc_scaling(const MincRange& range, const std::vector<ArrayAxis>& axes,
                          const ChosenAxes& chosen, ValueType stored, const std::string& name) {
    SliceScaling scaling;
    const bool real = stored == ValueType::f32 || stored == ValueType::f64;
    if (real) {
        return scaling;
    }
    take_all_of(stored, scaling);
    if (range.valid.size() == 2) {
        scaling.least = std::min(range.valid[0], range.valid[1]);
        scaling.most = std::max(range.valid[0], range.valid[1]);
    }
    if (!(scaling.most > scaling.least) || !std::isfinite(scaling.most - scaling.least)) {
        throw Error(ErrorKind::corrupt, {name, "valid_range"},
                    fmt::format("the valid range {} to {} is empty or infinite", scaling.least,
                                scaling.most));
    }
    std::size_t count = 1;
    std::vector<std::size_t> strides(axes.size(), 0);
    for (std::size_t i = range.dims; i-- > 0;) {
        strides[i] = count;
        count *= static_cast<std::size_t>(axes[i].length);
    }
    for (const auto& list : {range.most, range.least}) {
        if (!list.empty() && list.size() != count) {
            throw Error(ErrorKind::corrupt, {name, "image-max, image-min"},
                        fmt::format("{} numbers instead of {}", list.size(), count));
        }
    }
    // The lines of all positions; if the volume is at one position of an axis, from there on.
    scaling.lines.clear();
    std::size_t first = 0;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        first += strides[i] * static_cast<std::size_t>(chosen.at[i]);
    }
    for (std::size_t i = first; i < count; ++i) {
        const double most = range.most.empty() ? 1 : range.most[i];
        const double least = range.least.empty() ? 0 : range.least[i];
        const double slope = (most - least) / (scaling.most - scaling.least);
        if (!std::isfinite(slope)) {
            throw Error(ErrorKind::corrupt, {name, "image-max, image-min"},
                        fmt::format("invalid range of values: {} to {}", least, most));
        }
        scaling.lines.push_back({slope, least - scaling.least * slope});
    }
    for (std::size_t a = 0; a < 3; ++a) {
        if (chosen.axis.at(a)) {
            scaling.strides[static_cast<int>(a)] =
                static_cast<std::int64_t>(strides[*chosen.axis.at(a)]);
        }
    }
    return scaling;
}

std::string text_of(const MincRange& range, const SliceScaling& scaling, ValueType stored) {
    const bool kept =
        std::all_of(scaling.lines.begin(), scaling.lines.end(),
                    [](const SliceScaling::Line& line) { return line == SliceScaling::Line{}; });
    if (kept) {
        SliceScaling all;
        take_all_of(stored, all);
        return scaling.least <= all.least && scaling.most >= all.most
                   ? ""
                   : fmt::format("stored numbers outside {} to {} are clamped to this range",
                                 scaling.least, scaling.most);
    }
    const char* const from = range.most.empty() && range.least.empty()
                                 ? "0 to 1, because there is no image-min and image-max"
                                 : "image-min to image-max";
    return fmt::format("stored values {} to {} are scaled to {}", scaling.least, scaling.most,
                       from);
}

}  // namespace isonest::detail
