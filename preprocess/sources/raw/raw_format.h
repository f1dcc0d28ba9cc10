// Raw numbers: a file without a header.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// The caller has to describe them: it recognises every file.
VolumeFormat raw_format();

}  // namespace isonest::detail
