// Arrays of NumPy in files: .npy, and .npz with several of them.
#pragma once

#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Source: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
VolumeFormat npy_format();
/// An archive of such files, each stored or deflated.
VolumeFormat npz_format();

}  // namespace isonest::detail
