// FreeSurfer's volumes: .mgh, and packed by gzip .mgz.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Source: https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat
VolumeFormat mgh_format();

}  // namespace isonest::detail
