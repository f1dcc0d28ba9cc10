// Sources whose numbers are converted, scaled, or partly missing.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/int3.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

// Number types that volumes do not have: half floats and 64-bit integers.

enum class StoredNumber {
    f16,  ///< IEEE binary16: becomes float32
    i64,  ///< becomes float64
    u64   ///< becomes float64
};

/// The type in which `inner` must hold the bits of such numbers: uint16 or float64.
ValueType bits_type(StoredNumber stored);

/// The bits of the nearest half float; ties round to even.
std::uint16_t half_of(double value);

/// Interprets the bits of `inner` as such numbers. read() throws Error{unsupported} for integers
/// beyond 2^53, which float64 cannot represent.
std::unique_ptr<VolumeSource> converted(std::unique_ptr<VolumeSource> inner, StoredNumber stored);

/// Converts 64-bit integers in place. Throws Error{unsupported}.
void to_labels(const std::string& name, std::size_t count, std::byte* values);

/// If `source` holds such 64-bit integers, they are labels from now on (store/base/label_text.h),
/// and read() throws Error{unsupported} for those that cannot be labels. Otherwise does nothing.
void take_for_labels(VolumeSource& source);

// A source in which a value stands for "missing".

/// `inner` with values equal to `missing` replaced by NaN: as float32 if that represents all values
/// of the inner type (float32 and integers of up to 16 bits), otherwise as float64. Throws
/// Error{invalid_argument} if the inner type cannot hold `missing`.
std::unique_ptr<VolumeSource> with_missing(std::unique_ptr<VolumeSource> inner, double missing);

// A source whose file specifies a scaling of its numbers, and which of them are missing.

/// value = slope * stored + intercept.
struct Scaling {
    double slope = 1;
    double intercept = 0;
    /// Stored numbers that mean missing data (CF: _FillValue, missing_value); for float32 numbers,
    /// after rounding to float32.
    std::vector<double> missing = {};
    /// Stored numbers outside this range are missing data (CF: valid_range).
    double min_valid = -HUGE_VAL;
    double max_valid = HUGE_VAL;
    /// The smallest and largest stored number that is possible (DICOM: bits stored); by default
    /// those of the type. Values beyond them are an error of the file.
    std::optional<std::pair<std::int64_t, std::int64_t>> stored = {};
    [[nodiscard]] bool changes_nothing() const {
        return slope == 1 && intercept == 0 && missing.empty() && min_valid == -HUGE_VAL &&
               max_valid == HUGE_VAL;
    }
};

/// The type of scaled values. Integers stay integers if slope and intercept are integers, nothing
/// is missing, and an integer type of at least the stored width holds the whole range. Otherwise,
/// stored numbers of up to 16 bits and float32 become float32, the others float64.
ValueType scaled_type(ValueType stored, const Scaling& scaling);

/// "values are 0.01 times what is stored, plus 273.15; stored -32768 means missing"; empty if
/// nothing changes.
std::string text_of(const Scaling& scaling);

/// `inner` scaled; `inner` itself if the scaling changes nothing. Throws Error{invalid_argument,
/// corrupt} for a slope of 0 or a number that is not finite.
std::unique_ptr<VolumeSource> scaled(std::unique_ptr<VolumeSource> inner, const Scaling& scaling);

// A source whose slices are scaled individually.

/// value = slope * stored + intercept, after the stored number is clamped to [`least`, `most`].
struct SliceScaling {
    struct Line {
        double slope = 1;
        double intercept = 0;
        bool operator==(const Line&) const = default;
    };
    double least = -HUGE_VAL;
    double most = HUGE_VAL;
    std::vector<Line> lines{Line{}};
    Int3 strides{0, 0, 0};  ///< of `lines`, from one node to the next along x, y and z
};

/// `inner` scaled: integers of up to 16 bits and float32 to float32, others to float64. If all
/// lines are the identity, the type stays; if no number changes either, returns `inner` itself.
std::unique_ptr<VolumeSource> scaled_by_slices(std::unique_ptr<VolumeSource> inner,
                                               SliceScaling scaling);

}  // namespace isonest::detail
