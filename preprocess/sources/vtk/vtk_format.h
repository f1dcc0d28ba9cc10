// VTK's images: legacy files (.vtk) and XML (.vti).
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// STRUCTURED_POINTS, binary (big endian) or as text.
/// Source: https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html
VolumeFormat vtk_format();

/// One or several pieces; numbers appended (raw or base64), in base64 in the XML, or as text; not
/// packed, or with zlib, LZ4 or LZMA. Needs expat. Source:
/// https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
VolumeFormat vti_format();

}  // namespace isonest::detail
