// A volume in an HDF5 dataset.
#pragma once

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/volume_format.h"

namespace isonest::detail {

/// Whether the file has HDF5's signature: at its start, or behind a user block of 512 bytes, 1024,
/// 2048 and so on (MATLAB 7.3); of an object elsewhere, one of up to 32 KiB. Throws Error{io}.
bool is_hdf5(const InputFile& file);

VolumeFormat hdf5_format();

}  // namespace isonest::detail
