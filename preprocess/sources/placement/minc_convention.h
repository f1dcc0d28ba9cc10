// What MINC 1 (in NetCDF) and MINC 2 (in HDF5) say of a volume: where it lies, and what its numbers
// mean.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/value_type.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/wrapping/slice_scaled_source.h"

namespace isonest::detail {

/// A dimension of the image, and the attributes of the variable of its name.
struct MincDimension {
    std::string name;  ///< "zspace", "time", "vector_dimension"
    std::int64_t length = 1;
    std::vector<double> start = {};  ///< one number, or none where there is no such attribute
    std::vector<double> step = {};
    std::vector<double> cosines = {};  ///< `direction_cosines`: three numbers
    std::string spacing = {};          ///< "regular__" or "irregular"
    std::string units = {};
};

struct MincPlace {
    std::vector<ArrayAxis> axes;  ///< of the image, slowest first; only xspace, yspace and zspace
                                  ///< are of a volume
    std::vector<Double3> steps;   ///< along each, in the world (RAS)
    Double3 first{0, 0, 0};
    std::vector<bool> said;  ///< along each, whether there is a step
    std::optional<LengthUnit> unit = {};
};

/// As nibabel has it: the step along an axis is `step` (else 1) times its cosines (else along the
/// world's axis of its name); `start` (else 0) is along them, too. Millimetres, unless `units` say
/// something else. `with_spacing`: the caller gives one.
/// Throws Error{unsupported} where the spacing along an axis is irregular, unless `with_spacing`.
/// Source: https://en.wikibooks.org/wiki/MINC/Reference/MINC1-programmers-guide
MincPlace minc_place(const std::vector<MincDimension>& dims, bool with_spacing,
                     const std::string& name);

/// `image-max` and `image-min`, with an entry for each position on the first `dims` axes of the
/// image, and the valid range of stored numbers.
struct MincRange {
    std::vector<double> most = {};   ///< none: 1
    std::vector<double> least = {};  ///< none: 0
    std::size_t dims = 0;
    std::vector<double> valid = {};  ///< `valid_range`, else `valid_min` and `valid_max`; none: all
                                     ///< of the type
};

/// More entries are not read.
inline constexpr std::size_t kMostMincRanges = std::size_t{1} << 20U;

/// The valid range becomes the range of image-min to image-max, and numbers outside of it its ends,
/// as nibabel has it; floating point numbers stay as they are. Throws Error{corrupt} for ranges
/// that cannot be.
SliceScaling minc_scaling(const MincRange& range, const std::vector<ArrayAxis>& axes,
                          const ChosenAxes& chosen, ValueType stored, const std::string& name);

/// What it does, for a note; empty where it does nothing.
std::string text_of(const MincRange& range, const SliceScaling& scaling, ValueType stored);

}  // namespace isonest::detail
