// VTK's legacy images (.vtk).
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// STRUCTURED_POINTS, binary (big endian) or as text.
/// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html
VolumeFormat vtk_format();

}  // namespace isonest::detail
