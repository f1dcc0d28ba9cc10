// What the attributes of climate and forecast data (CF) say of stored numbers.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <isonest/value_type.h>

#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

/// The numbers of an attribute, or none if there is no such one, or it is text.
using NumbersOfAttribute = std::function<std::vector<double>(const std::string& name)>;

/// By `scale_factor`, `add_offset`, `_FillValue`, `missing_value`, `valid_min`, `valid_max` and
/// `valid_range`; the latter four, too, are of stored numbers. Missing data are only those that
/// the attributes name, not NetCDF's default fill values, as xarray has it.
/// Source: https://cfconventions.org/Data/cf-conventions/cf-conventions-1.11/cf-conventions.html,
/// sections 2.5.1 and 8.1. Throws Error{corrupt} for a scale factor of 0 or that is no number.
Scaling cf_scaling(const NumbersOfAttribute& attribute, const std::string& name);

/// Numbers of `bytes` bytes that are to be taken as unsigned (`_Unsigned`), but were read as
/// signed.
void take_as_unsigned(std::vector<double>& numbers, std::size_t bytes);

/// Coordinates that are packed as values may be: `scale_factor` and `add_offset` are applied, if
/// they are numbers and the factor is not 0.
void unpack(std::vector<double>& coordinates, const NumbersOfAttribute& attribute);

}  // namespace isonest::detail
