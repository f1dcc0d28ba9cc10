// NRRD files, with attached or detached header.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Source: http://teem.sourceforge.net/nrrd/format.html
VolumeFormat nrrd_format();

}  // namespace isonest::detail
