// How much preprocess() may change the values, so that their store becomes smaller.
//
// Values are rounded to multiples of a step before anything else. Levels, indicators and ranges are
// then those of the rounded values, and the store remembers the largest change, which every error
// bound of a query includes.
#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include <isonest/data_rounding.h>
#include <isonest/progress.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

namespace isonest {

/// Every value changes by at most `value`; 0: none changes.
struct WithinValue {
    double value = 0;
};
/// The same as a part of the difference between the largest and the smallest value, 0 to 1.
struct WithinRangePart {
    double part = 0;
};
/// Integers alone: multiples of 2^bits.
struct WithoutLowBits {
    int bits = 0;
};
/// At most half the noise that the values show, so that hardly any information is lost.
struct WithinNoise {};

using ValueTolerance = std::variant<WithinValue, WithinRangePart, WithoutLowBits, WithinNoise>;

/// Properties of a volume's values from which a tolerance is chosen.
struct ValueSurvey {
    double min = 0;  ///< smallest finite value; above `max` if there is none
    double max = 0;
    /// The standard deviation of noise that is independent from node to node; 0 if the values show
    /// none, or are not examined for it. Noise that is correlated between neighbours along x is
    /// underestimated.
    double noise = 0;
};

/// Whether rounding_of() needs a survey of the values, so that the volume has to be read twice.
bool needs_survey(const ValueTolerance& tolerance);

/// What rounding_of() needs for this tolerance. Reads the whole volume once, in pieces of at most a
/// quarter of `memory` bytes, or a row. Throws Error{cancelled}, and what the source throws.
ValueSurvey survey_values(VolumeSource& source, const ValueTolerance& tolerance,
                          std::uint64_t memory, Progress& progress = silent_progress());

/// The rounding of values of this type. For floating-point values the step is a power of two. For
/// integers it is a power of two if that is at least 3/4 of the largest possible step, or at least
/// 32 (because the low bytes of the values then compress best); otherwise the largest possible
/// step. `survey` is used if needs_survey(). Throws Error{invalid_argument}: bits of floating-point
/// values, more bits than the values have, a part above 1, or a number that is negative or beyond
/// the range of the type.
DataRounding rounding_of(const ValueTolerance& tolerance, ValueType type,
                         const ValueSurvey& survey = {});

/// "values within 2.5 (multiples of 5)"; empty if nothing is rounded.
std::string text_of(const DataRounding& rounding);

}  // namespace isonest
