// What an HDF5 file says of a dataset's axes and numbers beside the numbers. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <string>
#include <vector>

#include "preprocess/sources/placement/cf_convention.h"

namespace isonest::detail {

struct Hdf5Axis {
    std::string name;  ///< of the dimension scale, or its label; empty if there is neither
    std::vector<double> coordinates;  ///< one for each position; empty if there are none
    std::string unit;                 ///< of the scale (CF: `units`); empty if it does not say
};

/// For each axis of the dataset; `dims` are their lengths. Source: HDF5 Dimension Scale
/// Specification, https://docs.hdfgroup.org/archive/support/HDF5/doc/HL/H5DS_Spec.pdf
std::vector<Hdf5Axis> hdf5_axes(hid_t dataset, const std::vector<hsize_t>& dims);

/// Whether the dataset is itself the coordinates of an axis.
bool is_dimension_scale(hid_t dataset);

/// The numbers of an attribute of up to 16; none if it is text, or not there.
std::vector<double> numbers_of_attribute(hid_t object, const std::string& name);

/// Text of fixed or variable length; empty if it is none.
std::string text_of_attribute(hid_t object, const char* name);

/// NetCDF's `_Unsigned`: the signed integers that are stored mean unsigned ones.
bool is_said_unsigned(hid_t dataset);

}  // namespace isonest::detail
