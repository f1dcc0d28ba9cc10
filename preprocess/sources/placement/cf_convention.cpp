#include "preprocess/sources/placement/cf_convention.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

namespace isonest::detail {

Scaling cf_scaling(const NumbersOfAttribute& attribute, const std::string& name) {
    Scaling scaling;
    const auto one = [&](const char* key, double otherwise) {
        const std::vector<double> numbers = attribute(key);
        if (numbers.size() > 1) {
            throw Error(ErrorKind::corrupt, {name, key},
                        fmt::format("{} numbers in place of one", numbers.size()));
        }
        return numbers.empty() ? otherwise : numbers.front();
    };
    scaling.slope = one("scale_factor", 1);
    scaling.intercept = one("add_offset", 0);
    for (const char* const key : {"_FillValue", "missing_value"}) {
        for (const double number : attribute(key)) {
            // NaN is missing anyway.
            if (!std::isnan(number) && std::find(scaling.missing.begin(), scaling.missing.end(),
                                                 number) == scaling.missing.end()) {
                scaling.missing.push_back(number);
            }
        }
    }
    scaling.least_valid = one("valid_min", -HUGE_VAL);
    scaling.most_valid = one("valid_max", HUGE_VAL);
    if (const std::vector<double> range = attribute("valid_range"); range.size() == 2) {
        scaling.least_valid = range[0];
        scaling.most_valid = range[1];
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

}  // namespace isonest::detail
