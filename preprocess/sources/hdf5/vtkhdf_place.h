// Where VTK's images in HDF5 lie. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <optional>
#include <string>

#include "preprocess/sources/placement/placement.h"

namespace isonest::detail {

/// Of an array [z, y, x], of points or of cells (their centres), of an image in the group VTKHDF;
/// nothing for other datasets, and if the array is not of the image's extent. `straight`: without
/// its directions, with a spacing of 1. Throws as place_in_world() does.
/// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html
std::optional<Placement> vtkhdf_place(hid_t file, const std::string& dataset, const Int3& nodes,
                                      bool straight, const std::string& name, std::string& lost);

}  // namespace isonest::detail
