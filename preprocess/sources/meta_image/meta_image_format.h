// MetaImage: the format of ITK.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Header and numbers in one file (.mha) or in two (.mhd).
/// Source: https://itk.org/Wiki/ITK/MetaIO/Documentation
VolumeFormat meta_image_format();

}  // namespace isonest::detail
