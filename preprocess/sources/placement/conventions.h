// Conventions, shared by several formats, for the meaning of stored numbers and for their place.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/value_type.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

// The attributes of the climate and forecast conventions (CF) about stored numbers.

/// The numbers of an attribute; empty if there is no such attribute or it is text.
using NumbersOfAttribute = std::function<std::vector<double>(const std::string& name)>;

/// Reads `scale_factor`, `add_offset`, `_FillValue`, `missing_value`, `valid_min`, `valid_max` and
/// `valid_range`. All but the first two refer to stored numbers. Only the values in these
/// attributes are missing data, not NetCDF's default fill values; xarray does the same.
/// Source: https://cfconventions.org/Data/cf-conventions/cf-conventions-1.11/cf-conventions.html,
/// sections 2.5.1 and 8.1. Throws Error{corrupt} for a scale factor that is 0 or not a number.
Scaling cf_scaling(const NumbersOfAttribute& attribute, const std::string& name);

/// Reinterprets numbers of `bytes` bytes, read as signed, as unsigned (`_Unsigned`).
void take_as_unsigned(std::vector<double>& numbers, std::size_t bytes);

/// Unpacks coordinates, which may be packed like values: applies `scale_factor` and `add_offset` if
/// they are numbers and the factor is not 0.
void unpack(std::vector<double>& coordinates, const NumbersOfAttribute& attribute);

// What MINC 1 (in NetCDF) and MINC 2 (in HDF5) say about a volume: its place, and the meaning of
// its numbers.

/// A dimension of the image, with the attributes of the variable of the same name.
struct MincDimension {
    std::string name;  ///< "zspace", "time", "vector_dimension"
    std::int64_t length = 1;
    std::vector<double> start = {};  ///< one number; empty if there is no such attribute
    std::vector<double> step = {};
    std::vector<double> cosines = {};  ///< `direction_cosines`: three numbers
    std::string spacing = {};          ///< "regular__" or "irregular"
    std::string units = {};
};

struct MincPlace {
    /// Of the image, slowest first; only xspace, yspace and zspace are axes of a volume.
    std::vector<ArrayAxis> axes;
    std::vector<Double3> steps;  ///< along each axis, in the world (RAS)
    Double3 first{0, 0, 0};
    std::vector<bool> said;  ///< for each axis, whether there is a step
    std::optional<LengthUnit> unit = {};
};

/// Like nibabel: the step along an axis is `step` (default 1) times its cosines (default: the world
/// axis of its name). `start` (default 0) is measured along the cosines, too. In millimetres,
/// unless `units` says otherwise. `with_spacing`: the caller gives a spacing.
/// Throws Error{unsupported} if the spacing along an axis is irregular, unless `with_spacing`.
/// Source: https://en.wikibooks.org/wiki/MINC/Reference/MINC1-programmers-guide
MincPlace minc_place(const std::vector<MincDimension>& dims, bool with_spacing,
                     const std::string& name);

/// `image-max` and `image-min`, with one entry for each position on the first `dims` axes of the
/// image, and the valid range of stored numbers.
struct MincRange {
    std::vector<double> most = {};   ///< empty: 1
    std::vector<double> least = {};  ///< empty: 0
    std::size_t dims = 0;
    /// `valid_range`, otherwise `valid_min` and `valid_max`; empty: the whole range of the type
    std::vector<double> valid = {};
};

/// Maximum number of entries that are read.
inline constexpr std::size_t kMaxMincRanges = std::size_t{1} << 20U;

/// Maps the valid range to the range from image-min to image-max, and clamps numbers outside of it,
/// like nibabel; floating point numbers stay as they are. Throws Error{corrupt} for invalid ranges.
SliceScaling minc_scaling(const MincRange& range, const std::vector<ArrayAxis>& axes,
                          const ChosenAxes& chosen, ValueType stored, const std::string& name);

/// Describes the scaling in a note; empty if it does nothing.
std::string text_of(const MincRange& range, const SliceScaling& scaling, ValueType stored);

// The place of VTK images, in VTI and in VTKHDF.

struct VtkGrid {
    /// Row-major; the columns are the axes.
    std::array<double, 9> direction{1, 0, 0, 0, 1, 0, 0, 0, 1};
    Double3 spacing{1, 1, 1};

    /// The step along an axis in world coordinates.
    [[nodiscard]] Double3 step(std::size_t axis) const {
        return {direction[axis] * spacing[axis], direction[3 + axis] * spacing[axis],
                direction[6 + axis] * spacing[axis]};
    }
};

/// Moves `place` along an axis from index 0 to the first sample: a point or, if `between` points,
/// the centre of a cell.
inline void to_first_sample(Double3& place, const Double3& step, double low, bool between) {
    for (std::size_t w = 0; w < 3; ++w) {
        place.at(w) += step.at(w) * (low + (between ? 0.5 : 0));
    }
}

}  // namespace isonest::detail
