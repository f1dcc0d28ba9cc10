// NIfTI-1 and NIfTI-2 images.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// One file (.nii, .nii.gz) or a header and an image (.hdr, .img, each of them may be named).
/// Source: https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h, nifti2.h
VolumeFormat nifti_format();

}  // namespace isonest::detail
