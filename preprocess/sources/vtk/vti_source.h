// VTK's XML images (.vti).
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// One piece; numbers appended (raw or base64), in base64 in the XML, or as text; not packed or
/// with zlib. Needs expat. Source:
/// https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
VolumeFormat vti_format();

}  // namespace isonest::detail
