// DICOM: a file, a folder or a list of files with the images of a series.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

VolumeFormat dicom_format();

}  // namespace isonest::detail
