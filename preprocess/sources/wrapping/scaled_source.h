// A source whose file says that its numbers have to be scaled, and which of them mean nothing.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/volume_source.h>

namespace isonest::detail {

/// value = slope * stored + intercept.
struct Scaling {
    double slope = 1;
    double intercept = 0;
    /// Stored numbers that mean missing data (CF: _FillValue, missing_value); of float32 numbers
    /// those that these round to.
    std::vector<double> missing = {};
    /// Stored numbers outside of these are missing data (CF: valid_range).
    double least_valid = -HUGE_VAL;
    double most_valid = HUGE_VAL;
    /// The least and the largest stored number there can be (DICOM: bits stored); the type's if not
    /// given. Values beyond them are an error of the file.
    std::optional<std::pair<std::int64_t, std::int64_t>> stored = {};
    [[nodiscard]] bool changes_nothing() const {
        return slope == 1 && intercept == 0 && missing.empty() && least_valid == -HUGE_VAL &&
               most_valid == HUGE_VAL;
    }
};

/// The type of scaled values. Integers stay integers where slope and intercept are whole numbers,
/// nothing is missing and an integer type of at least the stored width holds the whole range;
/// otherwise stored numbers of up to 16 bits and float32 become float32, the others float64.
ValueType scaled_type(ValueType stored, const Scaling& scaling);

/// "values are 0.01 times what is stored, plus 273.15; stored -32768 means missing"; empty if
/// nothing changes.
std::string text_of(const Scaling& scaling);

/// `inner` scaled; itself where the scaling changes nothing. Throws Error{invalid_argument,
/// corrupt} for a slope of 0 or numbers that are none.
std::unique_ptr<VolumeSource> scaled(std::unique_ptr<VolumeSource> inner, const Scaling& scaling);

}  // namespace isonest::detail
